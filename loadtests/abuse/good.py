"""The client that must not notice anything: asks for one page again and again, on a connection that stays and on fresh ones by turns, and
tells on each line of standard input how that went since the last.

    good.py PORT PATH FILE_WITH_THE_PAGE
"""

import http.client
import json
import select
import sys
import time
from pathlib import Path

PAUSE_SECS = 0.02


def main() -> None:
    port, path, expected = int(sys.argv[1]), sys.argv[2], Path(sys.argv[3]).read_bytes()
    kept, fresh = None, False
    seen = {"asked": 0, "worst_ms": 0.0, "errors": []}
    while True:
        if select.select([sys.stdin], [], [], PAUSE_SECS)[0]:
            if not sys.stdin.readline():
                return
            print(json.dumps(seen), flush=True)
            seen = {"asked": 0, "worst_ms": 0.0, "errors": []}
        started = time.monotonic()
        connection = None if fresh else kept
        try:
            connection = connection or http.client.HTTPConnection("127.0.0.1", port, timeout=15)
            connection.request("GET", path)
            answer = connection.getresponse()
            body = answer.read()
            if (answer.status, body) != (200, expected):
                seen["errors"].append(f"status {answer.status} with {len(body)} bytes")
        except (OSError, http.client.HTTPException) as error:
            seen["errors"].append(f"{type(error).__name__}: {error}")
            connection.close()
            connection = None
        seen["asked"] += 1
        seen["worst_ms"] = max(seen["worst_ms"], 1000 * (time.monotonic() - started))
        if fresh and connection:
            connection.close()
        elif not fresh:
            kept = connection
        fresh = not fresh


if __name__ == "__main__":
    main()
