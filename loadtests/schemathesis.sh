#!/usr/bin/env bash
# Requests made up from the server's own OpenAPI document, and every answer held against it: `make schemathesis`. Installs schemathesis
# into target/schemathesis where it is not there.
#
#   EXAMPLES=200 (a route)
set -eu
cd "$(dirname "$0")/.."
bin=$(realpath "${CARGO_TARGET_DIR:-target}")/release
out=$PWD/target/schemathesis
mkdir -p "$out"
run=$(command -v schemathesis || true)
if [ -z "$run" ]; then
  run=$out/venv/bin/schemathesis
  [ -x "$run" ] || { python3 -m venv "$out/venv" && "$out/venv/bin/pip" install --quiet --disable-pip-version-check schemathesis==4.32.5; } || {
    echo "needs schemathesis (pip install schemathesis), or python3 with venv and the network" >&2
    exit 1
  }
fi
[ -f "$out/rock.glb" ] || "$bin/lodestream-loadtests" sample rock --out "$out/rock.glb" -q
"$bin/lodestream-server" ingest "$out/rock.glb" --library "$out/library" --scene rock -q
token=a-token-for-schemathesis
echo $token >"$out/tokens"
"$bin/lodestream-server" serve --library "$out/library" --listen 127.0.0.1:7985 --upload-tokens "$out/tokens" --upload-bytes 1MiB \
  --upload-secs 20 >"$out/serve.log" 2>&1 &
server=$!
trap 'kill "$server" 2>/dev/null || true' EXIT
for _ in $(seq 100); do
  curl -sf http://127.0.0.1:7985/readyz >/dev/null && break
  sleep 0.1
done
root=$PWD
# Where it keeps what it found.
cd "$out"
"$run" --config-file "$root/loadtests/schemathesis.toml" run http://127.0.0.1:7985/v1/openapi.json --max-examples "${EXAMPLES:-200}" --checks all --no-color -H "Authorization: Bearer $token"
kill -0 "$server" || { echo "the server is gone"; tail -5 "$out/serve.log"; exit 1; }
! grep -i "panicked" "$out/serve.log"
