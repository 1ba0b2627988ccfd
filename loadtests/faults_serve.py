"""`serve` over a store that fails, for `faults.py`: every answer is held against those over the healthy store."""

import collections
import http.client
import itertools
import json
import os
import random
import re
import struct
import subprocess
import threading
import time

from faults_proxy import Proxy

# A request to the store has 30 s, and the server may look a second time before it says what is wrong.
BOUND_SECS = 70
# After the fault; a busy machine with two cores needs that much for anything.
RECOVER_SECS = 5
READY_SECS = 4
# Pages in memory need no store.
HELD_SECS = 2
PEAK_MIB = 400
# Ten clients with 30 ms between two questions each are few: what is logged must not grow with them.
LOG_LINES_A_SEC = 50
# Faults under which the store says that nothing is there.
MISSING = (404, "names 404")
FAULT_SECS = float(os.environ.get("FAULT_SECS", "5"))
# Pages of the large asset that are in memory before the fault comes.
HELD = 8

Answer = collections.namedtuple("Answer", "status body secs")


def ask(port, path, post=None, part=None, bound=BOUND_SECS):
    """The status is "cut" for an answer that broke off, "hung" for one of which nothing came for a while, "still coming" for one that was not whole in time."""
    start, status, body = time.monotonic(), "cut", b""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=bound)
    try:
        headers = {"Range": f"bytes={part[0]}-{part[1] - 1}"} if part else {}
        connection.request("POST" if post else "GET", path, post and json.dumps(post), headers)
        answer = connection.getresponse()
        while piece := answer.read1(1 << 16):
            body += piece
            if time.monotonic() - start > bound:
                status = "still coming"
                break
        else:
            # What is still missing of the length that was promised.
            status = "cut" if answer.length else answer.status
    except TimeoutError:
        status = "hung"
    except (OSError, http.client.HTTPException):
        pass
    finally:
        connection.close()
    return Answer(status, body, time.monotonic() - start)


class Server:
    def __init__(self, binary, library, log, environment=None):
        self.log = log
        with open(log, "w") as file:
            command = [binary, "serve", "--library", library, "--listen", "127.0.0.1:0"]
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=file, text=True, env=environment)
        self.port = int(self.process.stdout.readline().rsplit(":", 1)[1])

    def stop(self):
        """Peak memory in MiB, and what it logged."""
        with open(f"/proc/{self.process.pid}/status") as file:
            peak = int(re.search(r"VmHWM:\s*(\d+)", file.read())[1]) >> 10
        self.process.kill()
        self.process.wait()
        return peak, self.log.read_text().splitlines()


class Right:
    """Every answer of a healthy server. `assets` begins with the large one; `objects` are the bytes by name."""

    def __init__(self, port, scenes, assets, objects):
        self.assets, self.pages = assets, {}
        self.names = ["/v1/scenes", *(f"/v1/scenes/{name}" for name in scenes)]
        self.opens = [f"/v1/scenes/{name}/open" for name in scenes]
        self.bodies = {path: ask(port, path).body for path in self.names + self.opens}
        objects = {f"/v1/objects/{name}": body for name, body in objects.items()}
        self.objects = sorted(objects, key=lambda path: len(objects[path]))
        self.bodies.update(objects)
        for asset in assets:
            for page in itertools.count():
                path = f"/v1/assets/{asset}/pages/{page}-{page}"
                answer = ask(port, path)
                if answer.status == 404:
                    break
                self.pages[asset, page], self.bodies[path] = path, answer.body
        self.cold = [page for asset, page in self.pages if asset == assets[0] and page >= HELD + 4]

    def post(self, pages):
        """A post for pages, the first one the most urgent."""
        wants = [{"asset": asset, "first": page, "last": page, "priority": -at} for at, (asset, page) in enumerate(pages)]
        return {"viewer": random.randrange(1 << 32), "sequence": 1, "wants": wants}

    def judge(self, answer, path, post=None, part=None):
        """What the answer is: "right", "wrong", or the kind of error."""
        if answer.status not in (200, 206):
            return answer.status
        if not post:
            expected = self.bodies[path]
            if part:
                # Objects have one hash, over all of it: whoever asks for a part must check it when it has the whole.
                return "right" if answer.body == expected[slice(*part)] else "wrong part"
            return "right" if answer.body == expected else "wrong"
        at, found, wanted = 0, set(), {(want["asset"], want["first"]) for want in post["wants"]}
        while at + 56 <= len(answer.body):
            _, kind, status, page, length, name = struct.unpack_from("<4sIIIQ32s", answer.body, at)
            frame = answer.body[at + 56 : at + 56 + length]
            at += 56 + length
            if kind == 0:
                break
            if status == 0 and frame != self.bodies[self.pages[name.hex(), page]]:
                return "wrong"
            in_memory = name.hex() == self.assets[0] and page < HELD
            failed = "page not there" if status == 1 else "page in memory failed" if in_memory else "page failed"
            found.add(failed if status else "right")
            wanted.discard((name.hex(), page))
        found |= {"cut"} if kind or wanted else set()
        return max(found - {"right"}, default="right")


class Serve:
    """One server over one fault."""

    def __init__(self, fault, right, binary, library, environment, out):
        self.fault, self.right, self.broken = fault, right, []
        self.lock, self.counts, self.texts = threading.Lock(), collections.Counter(), {}
        self.error_secs, self.recover_secs, self.random = 0.0, 0.0, random.Random(fault.name)
        self.proxy, self.from_start = Proxy(), "start" in fault.name
        self.run(binary, library, environment(self.proxy), out)

    def questions(self):
        """What each worker asks for, anew each time."""
        right, big, choice = self.right, self.right.assets[0], self.random.choice
        held = [(big, page) for page in range(HELD)]
        cold = lambda: (big, choice(right.cold))

        def post():
            """As viewers do: neighbours, which are read together. What is in memory comes last and must not be lost."""
            first = choice(right.cold[:-6])
            return ("/v1/pages", right.post([*((big, page) for page in range(first, first + 6)), choice(held)]))

        size = len(right.bodies[right.objects[-1]])
        return {
            "page": lambda: (right.pages[cold()],),
            "page in memory": lambda: (right.pages[choice(held)],),
            "object": lambda: (choice(right.objects[:-1]),),
            "large object": lambda: (right.objects[-1],),
            "part": lambda: (right.objects[-1], None, sorted(self.random.sample(range(size), 2))),
            "post": post,
            "open": lambda: (choice(right.opens),),
            "name": lambda: (choice(right.names),),
        }

    def once(self, kind, question):
        path = question()
        answer = ask(self.server.port, *path)
        judged = self.right.judge(answer, *path)
        if judged == "wrong" and path[0] == "/v1/scenes" and self.fault.kind in MISSING:
            # A name that is listed and then is not there was removed meanwhile.
            judged = "shorter list"
        with self.lock:
            self.counts["requests"] += 1
            self.counts[judged] += 1
            if judged != "right":
                self.error_secs = max(self.error_secs, answer.secs)
                text = answer.body.decode(errors="replace") if answer.status not in (200, 206, "cut", "hung", "still coming") else ""
                self.note(judged, text, kind, answer.secs)
                if text and (not re.fullmatch(r"[^\n]{8,200}\n", text) or re.search("s3:|http:|127[.]", text)):
                    self.break_(f"{judged} with the text {text!r}")
            if judged in (404, "page not there") and self.fault.kind not in MISSING:
                self.break_(f"{kind}: {judged}, although the store never said so")
            if judged in ("wrong", "hung") or (judged == "page in memory failed" and not self.from_start):
                self.break_(f"{kind}: {judged}")
            if kind == "page in memory" and (judged != "right" or answer.secs > HELD_SECS):
                self.break_(f"page in memory: {judged} after {answer.secs:.1f} s")
        return judged == "right"

    def note(self, judged, text, kind, secs):
        kinds = self.texts.setdefault((judged, re.sub("([0-9a-f]{2}/)?[0-9a-f]{64}", "HASH", text)), {})
        kinds[kind] = max(kinds.get(kind, 0), secs)

    def said(self):
        """Errors, with the longest time that each took to come."""
        for (judged, text), kinds in self.texts.items():
            yield f"{judged} {text.strip()!r}: " + ", ".join(f"{kind} {secs:.1f} s" for kind, secs in kinds.items())
        yield f"log: {self.log}; {self.log_line}"

    def break_(self, text):
        if text not in self.broken and len(self.broken) < 8:
            self.broken.append(text)

    def health(self, until):
        # The verdict of /readyz may be a second old.
        told = time.monotonic() + 1.5
        while time.monotonic() < until:
            ready, alive = ask(self.server.port, "/readyz"), ask(self.server.port, "/healthz")
            late = ready.secs > READY_SECS
            if late or (self.fault.total and ready.status != 503 and told < time.monotonic() < until):
                self.break_(f"/readyz: {ready.status} after {ready.secs:.1f} s")
            if alive.status != 200:
                self.break_(f"/healthz: {alive.status}")
            self.note(ready.status, ready.body.decode(), "/readyz", ready.secs)
            time.sleep(0.3)

    def run(self, binary, library, environment, out):
        fault, questions = self.fault, self.questions()
        if self.from_start:
            # Nothing is in memory.
            del questions["page in memory"]
            self.proxy.call(self.proxy.switch(fault))
        self.server = Server(binary, library, out / f"serve-{fault.slug}.log", environment)
        if not self.from_start:
            for page in range(HELD):
                path = self.right.pages[self.right.assets[0], page]
                if self.right.judge(ask(self.server.port, path), path) != "right":
                    self.break_("a page was wrong before the fault")
            self.proxy.call(self.proxy.switch(fault))
        start = time.monotonic()
        until = start + (2 if fault.kind == "back" else FAULT_SECS)

        def work(kind, question):
            self.once(kind, question)
            while time.monotonic() < until:
                time.sleep(0.03)
                self.once(kind, question)

        workers = [threading.Thread(target=work, args=item) for item in questions.items()]
        workers.append(threading.Thread(target=self.health, args=(until,)))
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        secs = time.monotonic() - start
        self.proxy.call(self.proxy.switch(None))
        self.recover(questions)
        peak, log = self.server.stop()
        errors = sum(self.counts.values()) - sum(self.counts[key] for key in ("requests", "right"))
        self.log = f"{len(log)} lines for {errors} errors in {secs:.0f} s, peak {peak} MiB"
        self.log_line = next((re.sub(r"\x1b\[[0-9;]*m", "", line) for line in log), "")
        if len(log) / secs > LOG_LINES_A_SEC:
            self.break_(f"{len(log) / secs:.0f} lines a second in the log")
        if peak > PEAK_MIB:
            self.break_(f"{peak} MiB of memory")
        self.proxy.call(self.proxy.close())

    def recover(self, questions):
        """Seconds until everything was right again, then everything once."""
        start, right = time.monotonic(), self.right
        for kind, question in {**questions, "ready": None}.items():
            while time.monotonic() < start + BOUND_SECS:
                path = question() if question else ("/readyz",)
                answer = ask(self.server.port, *path)
                if answer.status == 200 if not question else right.judge(answer, *path) == "right":
                    break
                time.sleep(0.05)
        self.recover_secs = time.monotonic() - start
        if self.recover_secs > RECOVER_SECS:
            self.break_(f"{self.recover_secs:.0f} s until all was right again")
        everything = [(path,) for path in right.bodies] + [("/v1/pages", right.post(list(right.pages)))]
        for path in everything:
            answer = ask(self.server.port, *path)
            judged = right.judge(answer, *path)
            if judged == "wrong":
                self.counts["wrong"] += 1
            if judged != "right" or answer.secs > RECOVER_SECS:
                self.break_(f"once the fault was over: {judged} after {answer.secs:.1f} s")
