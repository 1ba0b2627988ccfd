#!/usr/bin/env bash
# Three servers over one S3 library behind nginx, which balances and caches; in every round one of them is killed while viewers stream, and no viewer may see an
# error: `make replicas`. The S3 server is a SeaweedFS of .ci/s3.
#
#   VIEWERS=60 SECS=8 ROUNDS=5
set -eu
cd "$(dirname "$0")/.."
PATH=$PATH:/usr/sbin
for tool in nginx curl python3; do
  command -v "$tool" >/dev/null || missing+=" $tool"
done
if [ -n "${missing-}" ]; then
  echo "needs$missing (Debian: apt-get install nginx-light curl python3)" >&2
  exit 1
fi
[ -n "${LODESTREAM_TEST_S3-}" ] || exec .ci/s3 "$0"
bin=${CARGO_TARGET_DIR:-target}/release
out=$PWD/target/replicas
rm -rf "$out"
mkdir -p "$out"
"$bin/lodestream-loadtests" sample rock --out "$out/rock.glb" -q
library=$LODESTREAM_TEST_S3/replicas
"$bin/lodestream-server" ingest "$out/rock.glb" --library "$library" --scene rock -q
servers=()
stop() {
  kill "${servers[@]}" 2>/dev/null || true
  [ ! -f "$out/nginx.pid" ] || kill "$(cat "$out/nginx.pid")" 2>/dev/null || true
}
trap stop EXIT
start() {
  "$bin/lodestream-server" serve --library "$library" --listen "127.0.0.1:$((7991 + $1))" >"$out/serve-$1.log" 2>&1 &
  servers[$1]=$!
}
for replica in 0 1 2; do start $replica; done
cat >"$out/nginx.conf" <<CONF
worker_processes 1;
pid $out/nginx.pid;
error_log $out/nginx.log;
events { worker_connections 4096; }
http {
  access_log off; tcp_nodelay on;
  client_body_temp_path $out/tmp; proxy_temp_path $out/tmp; fastcgi_temp_path $out/tmp; uwsgi_temp_path $out/tmp; scgi_temp_path $out/tmp;
  proxy_cache_path $out/cache keys_zone=pages:10m max_size=1g;
  upstream replicas { least_conn; server 127.0.0.1:7991; server 127.0.0.1:7992; server 127.0.0.1:7993; keepalive 64; }
  server {
    listen 127.0.0.1:7990;
    proxy_http_version 1.1; proxy_set_header Connection "";
    # Answers to a post are made while they are sent: asked for anew elsewhere where a server goes before the first byte.
    proxy_next_upstream error timeout http_503 non_idempotent;
    location / { proxy_pass http://replicas; proxy_buffering off; }
    # Immutable: one replica is asked once.
    location /v1/assets/ { proxy_pass http://replicas; proxy_cache pages; proxy_cache_valid 200 365d; proxy_cache_lock on; proxy_cache_use_stale error timeout http_503; }
    location /v1/objects/ { proxy_pass http://replicas; proxy_cache pages; proxy_cache_valid 200 365d; proxy_cache_lock on; }
  }
}
CONF
nginx -c "$out/nginx.conf" -e "$out/nginx.log"
ready() {
  for try in $(seq 100); do
    curl -sf "http://127.0.0.1:$1/readyz" >/dev/null && return
    sleep 0.1
  done
  echo "nothing answers at port $1" >&2
  exit 1
}
for port in 7991 7992 7993 7990; do ready $port; done
secs=${SECS:-8}
for round in $(seq "${ROUNDS:-5}"); do
  killed=$((round % 3))
  # Links so slow that every viewer is still in the middle of it.
  "$bin/lodestream-loadtests" load http://127.0.0.1:7990 --scene rock --viewers "${VIEWERS:-60}" --seconds "$secs" --bandwidth 4 --latency 20 \
    --report "$out/load-$round.json" >"$out/load-$round.txt" 2>&1 &
  load=$!
  sleep 1.$((RANDOM % 10))
  kill -9 "${servers[$killed]}"
  wait "$load" || { cat "$out/load-$round.txt"; exit 1; }
  start $killed
  ready $((7991 + killed))
done
python3 - "$out"/load-*.json <<'PY'
import json, sys

failed = 0
for file in sys.argv[1:]:
    report = json.load(open(file))
    failed += report["errors"]
    print(
        f"{report['viewers']} viewers, {report['requests']} requests, {report['pages']} pages, settled {report['settled_viewers']} "
        f"(p95 {report['settled_secs']['p95']:.1f} s), errors {report['errors']} {report.get('first_error', '')}"
    )
print(f"{len(sys.argv) - 1} replicas killed under load, {failed} errors that viewers saw")
sys.exit(failed > 0)
PY
