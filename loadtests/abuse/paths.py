"""Paths that mean to leave the library. None may be found, and no answer may hold what lies beside it."""

import secrets

from talk import tally, talk, together

# Planted in the library's folder and beside it; `root:` is what /etc/passwd begins with.
SECRET = secrets.token_hex(16)
UP = ["..", "%2e%2e", "%2E%2E", "..%2f..", "%2e%2e%2f%2e%2e", "..%5c..", "..\\..", "..%255c..", "%252e%252e", "..%252f..", "..%c0%af..",
      "..%ef%bc%8f..", "....//", "..;", "rock/..", "rock%2f..", "rock%00..", ".%2e", "rock/../.."]
NAMES = ["secret", "library%2fsecret", "..%2fsecret", "etc%2fpasswd", "%2fetc%2fpasswd", "scenes%2frock"]
ALONE = [".", "..", "%2e", "%00", "%", "%zz", "%ff%fe", "rock%00", "rock%00.json", "rock%20", "rock%0d%0aa:b", "rock\\", ".rock", "-rock",
         "/", "//", "rock/", "rock//", "/etc/passwd", "%2fetc%2fpasswd", "file:%2f%2f%2fetc%2fpasswd", "C:%5cwindows", "con", "secret", "*",
         "~root", "$HOME", "%24%28id%29", "rock;", "rock:", "a" * 201, "a" * 4096, "a" * 60_000, "../" * 2000 + "etc/passwd",
         "%2e%2e%2f" * 2000 + "etc%2fpasswd", "a/" * 20_000, "%2500", "rock%2fopen", "r%C3%B6ck", "rock%e2%80%ae", "{scene}",
         "0-0/../../secret", "0-%00", "00-1", "0-4294967296", "-1-0", "0-18446744073709551616"]


def paths(rig) -> None:
    asset, pack = rig.target.asset, rig.target.pack
    routes = ["/v1/scenes/{}", "/v1/scenes/{}/open", "/v1/objects/{}", f"/v1/objects/{pack}{{}}", "/v1/assets/{}/pages/0-0",
              f"/v1/assets/{asset}/pages/{{}}", f"/v1/assets/{asset}/{{}}", "/v1/{}", "/{}"]
    tricks = [f"{up}{slash}{name}" for up in UP for slash in ("/", "%2f", "%5c") for name in NAMES] + ALONE
    hashes = [pack.upper(), pack[:-1], pack + "0", f"{pack[:2]}/{pack}", f"{pack}%00", f"%{ord(pack[0]):02x}" + "%2e" + pack[2:]]
    cases = [("GET", route.replace("{}", trick)) for route in routes for trick in tricks]
    cases += [(method, route.replace("{}", trick)) for route in routes for trick in ALONE for method in ("HEAD", "PUT", "POST")]
    cases += [("GET", f"/v1/objects/{name}") for name in hashes] + [("GET", f"/v1/assets/{name}/pages/0-0") for name in hashes]

    def ask(method: str, path: str) -> tuple:
        found = talk(rig.port, f"{method} {path} HTTP/1.1\r\nHost: a\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode())
        return found.outcome, SECRET.encode() in found.raw or b"root:" in found.raw

    before = sorted(rig.target.folder.iterdir())
    with rig.attack("paths out of the library") as row:
        row.attempts = len(cases)
        outcomes = together(ask, cases)
        for (method, path), (outcome, told) in zip(cases, outcomes):
            row.check(outcome in {400, 403, 404, 405, 414, 431}, f"{method} {path[:80]}: 400, 403, 404, 405, 414 or 431", outcome)
            row.check(not told, f"{method} {path[:80]}: nothing of what lies beside the library", "it")
        row.check(sorted(rig.target.folder.iterdir()) == before, "nothing new beside the library", sorted(rig.target.folder.iterdir()))
        row.note(tally([outcome for outcome, _ in outcomes]))
