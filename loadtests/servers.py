"""Measures what `servers.sh` started: the table of page requests a second, latency, processor time a request and memory."""

import itertools
import json
import os
import random
import re
import statistics
import subprocess
import sys
import time
import urllib.error
import urllib.request

binary, library, scene, out, *our_pids = sys.argv[1:]
CONNECTIONS = [int(count) for count in os.environ.get("CONNECTIONS", "16 64 256 1024").split()]
STREAMS = [int(count) for count in os.environ.get("STREAMS", "32 128").split()]
ROUNDS = int(os.environ.get("ROUNDS", "3"))
SECS = int(os.environ.get("SECS", "3"))
OURS = "http://127.0.0.1:7979"
OTHERS = {name: port for name, port in (("lighttpd", 7983), ("h2o", 7984)) if os.path.exists(f"{out}/{name}.pid")}
PORTS = {"lodestream": 7979, "nginx": 7980, "nginx, tcp_nopush off": 7981, "lodestream, folder": 7978, **OTHERS}
STREAM_PORTS = {"lodestream": 7979, "nginx": 7990, **OTHERS, "lodestream TLS": 7982, "nginx TLS": 8000}
OUR_PIDS = dict(zip(("lodestream", "lodestream TLS", "lodestream, folder", "lodestream, before"), map(int, our_pids)))
if "lodestream, before" in OUR_PIDS:
    PORTS["lodestream, before"] = STREAM_PORTS["lodestream, before"] = 7977
TICK_MICROSECONDS = 1e6 / os.sysconf("SC_CLK_TCK")


def fetch(path):
    """The body, or None past the last page."""
    try:
        with urllib.request.urlopen(OURS + path) as answer:
            return answer.read()
    except urllib.error.HTTPError as error:
        if error.code == 404:
            return None
        raise


def pages_to_files():
    """Stores every page of the scene where nginx finds it under the same path; gives paths and mean bytes."""
    report = out + "/show.json"
    subprocess.run([binary, "show", scene, "--library", library, "--assets", "--report", report, "-q"], check=True, stdout=subprocess.DEVNULL)
    with open(report) as file:
        assets = json.load(file)["assets_table"]
    paths, total = [], 0
    for asset in assets:
        folder = f"/v1/assets/{asset['asset']}/pages"
        os.makedirs(out + "/www" + folder, exist_ok=True)
        for page in itertools.count():
            path = f"{folder}/{page}-{page}"
            body = fetch(path)
            if body is None:
                break
            total += len(body)
            with open(out + "/www" + path, "wb") as file:
                file.write(body)
            paths.append(path)
    return paths, total / len(paths)


def processes(name):
    """Process numbers of a server: our one, or another's master and workers."""
    if name in OUR_PIDS:
        return [OUR_PIDS[name]]
    conf = "nginx-push" if name.endswith("off") else name.split()[0]
    with open(f"{out}/{conf}.pid") as file:
        master = int(file.read())
    children = subprocess.run(["pgrep", "-P", str(master)], capture_output=True, text=True).stdout.split()
    return [master] + [int(child) for child in children]


def used(name):
    """Processor microseconds so far, and resident MB of its own now (what is a file's is the system's to let go of)."""
    ticks, kilobytes = 0, 0
    for process in processes(name):
        with open(f"/proc/{process}/stat") as file:
            fields = file.read().rsplit(")", 1)[1].split()
        ticks += int(fields[11]) + int(fields[12])
        with open(f"/proc/{process}/status") as file:
            kilobytes += int(re.search(r"RssAnon:\s+(\d+)", file.read())[1])
    return ticks * TICK_MICROSECONDS, kilobytes / 1024


def milliseconds(text):
    number, unit = re.fullmatch(r"([\d.]+)(us|ms|s|m)", text).groups()
    return float(number) * {"us": 1e-3, "ms": 1, "s": 1e3, "m": 6e4}[unit]


def measure(name, connections):
    before, _ = used(name)
    command = ["wrk", "-t2", f"-c{connections}", f"-d{SECS}s", "--latency", "-s", out + "/pages.lua"]
    text = subprocess.run(command + [f"http://127.0.0.1:{PORTS[name]}"], check=True, capture_output=True, text=True).stdout
    after, megabytes = used(name)
    requests = int(re.search(r"(\d+) requests in", text)[1])
    errors = sum(int(count) for count in re.findall(r"(?:connect|read|write|timeout) (\d+)", text))
    errors += sum(int(count) for count in re.findall(r"Non-2xx or 3xx responses: (\d+)", text))
    latency = lambda percent: milliseconds(re.search(rf"^\s+{percent}%\s+(\S+)", text, re.M)[1])
    return {
        "requests_per_s": float(re.search(r"Requests/sec:\s+([\d.]+)", text)[1]),
        "p50_ms": latency("50"),
        "p99_ms": latency("99"),
        "cpu_us": (after - before) / max(requests, 1),
        "resident_mb": megabytes,
        "errors": errors,
    }


def measure_streams(name, streams):
    """As `measure`, over one HTTP/2 connection; h2load gives no percentiles."""
    scheme = "https" if name.endswith("TLS") else "http"
    urls = out + "/urls.txt"
    with open(urls, "w") as file:
        for path in random.sample(paths, len(paths)):
            file.write(f"{scheme}://127.0.0.1:{STREAM_PORTS[name]}{path}\n")
    before, _ = used(name)
    command = ["h2load", "-c1", "-t1", f"-m{streams}", f"-D{SECS}", "-w30", "-W30", "-i", urls]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    after, megabytes = used(name)
    done, failed = (int(re.search(r"(\d+) " + word, text)[1]) for word in ("succeeded", "failed"))
    mean = re.search(r"time for request:\s+\S+\s+\S+\s+(\S+)", text)[1]
    return {
        "requests_per_s": float(re.search(r"([\d.]+) req/s", text)[1]),
        "mean_ms": milliseconds(mean),
        "cpu_us": (after - before) / max(done, 1),
        "resident_mb": megabytes,
        "errors": failed,
    }


def table(title, counts, names, of, measure):
    """Measures and prints rows; gives them."""
    print(f"{title:>22} {'':5} {'req/s':>8} {'GB/s':>5} {'of nginx':>8} {'p50 ms':>7} {'p99 ms':>7} {'CPU us':>6} {'own MB':>6} {'errors':>6}")
    rows = []
    for count in counts:
        found = {name: [] for name in names}
        for number in range(ROUNDS):
            # In another order each time, for what one leaves behind is the next one's loss: a tenth, right after h2o.
            for name in random.Random(number).sample(list(names), len(names)):
                time.sleep(0.3)
                found[name].append(measure(name, count))
        medians = {
            name: {key: statistics.median(run[key] for run in runs) for key in runs[0]} for name, runs in found.items()
        }
        for name, row in medians.items():
            row["of_nginx"] = row["requests_per_s"] / medians[of(name)]["requests_per_s"]
            rows.append({"server": name, "connections_or_streams": count, "mean_bytes": mean_bytes, **row})
            cell = lambda key: f"{row[key]:7.2f}" if key in row else f"{'-':>7}"
            print(
                f"{name:>22} {count:5} {row['requests_per_s']:8.0f} {row['requests_per_s'] * mean_bytes / 1e9:5.2f} {row['of_nginx']:8.2f}"
                f" {cell('p50_ms')} {cell('p99_ms')} {row['cpu_us']:6.1f} {row['resident_mb']:6.0f} {row['errors']:6.0f}",
                flush=True,
            )
    return rows


paths, mean_bytes = pages_to_files()
with open(out + "/pages.lua", "w") as file:
    file.write("local paths = {%s}\n" % ",".join(f'"{path}"' for path in paths))
    # Each thread its own sequence.
    file.write("local thread = 0\nfunction setup(t) thread = thread + 1; t:set('seed', thread) end\n")
    file.write("function init() math.randomseed(seed) end\n")
    file.write("function request() return wrk.format('GET', paths[math.random(#paths)]) end\n")
print(f"{len(paths)} pages of {mean_bytes / 1024:.1f} KiB on average, {ROUNDS} rounds of {SECS} s, medians")
rows = table("connections, HTTP/1.1", CONNECTIONS, PORTS, lambda name: "nginx", measure)
of = lambda name: "nginx TLS" if name.endswith("TLS") else "nginx"
streams = table("streams, one HTTP/2", STREAMS, STREAM_PORTS, of, measure_streams)
with open(out + "/servers.json", "w") as file:
    json.dump({"connections": rows, "streams": streams}, file, indent=1)
