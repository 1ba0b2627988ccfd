#!/usr/bin/env bash
# Page requests a second against nginx over the same bytes, in one run: `make servers`. Both serve every page of a scene at the same
# URLs on loopback, to wrk (HTTP/1.1) and h2load (one HTTP/2 connection, in cleartext and over TLS) on the same machine; rounds
# alternate, the table shows medians. "folder" is our server with no room for pages of its own. lighttpd and h2o take part where they
# are installed.
#
#   LIBRARY, SCENE   a library and a scene in it (else the sample rock is ingested, of TRIANGLES 12000000)
#   BEFORE           an older lodestream-server, in the same rounds: "lodestream, before"
#   CONNECTIONS      "16 64 256 1024"      STREAMS "32 128"      ROUNDS 3      SECS 3      CACHE_BYTES of `lodestream-server serve`
set -eu
cd "$(dirname "$0")/.."

for tool in nginx wrk h2load curl openssl python3; do
  command -v "$tool" >/dev/null || PATH=$PATH:/usr/sbin command -v "$tool" >/dev/null || missing+=" $tool"
done
if [ -n "${missing-}" ]; then
  echo "needs$missing (Debian: apt-get install nginx-light wrk nghttp2-client curl openssl python3)" >&2
  exit 1
fi
PATH=$PATH:/usr/sbin
bin=${CARGO_TARGET_DIR:-target}/release
out=$PWD/target/servers
mkdir -p "$out"
rm -rf "$out/www"
mkdir "$out/www"

if [ -z "${LIBRARY-}" ]; then
  # 1,200 pages of 64 KiB, more than the processor's caches hold.
  LIBRARY=$out/library SCENE=rock-${TRIANGLES:=12000000}
  rock=$out/$SCENE.glb
  [ -f "$rock" ] || "$bin/lodestream-loadtests" sample rock --triangles "$TRIANGLES" --out "$rock" -q
  "$bin/lodestream-server" ingest "$rock" --library "$LIBRARY" --scene "$SCENE" --codec lz4 -q
fi

ours=http://127.0.0.1:7979
"$bin/lodestream-server" serve --library "$LIBRARY" --listen 127.0.0.1:7979 ${CACHE_BYTES:+--cache-bytes "$CACHE_BYTES"} >"$out/serve.log" 2>&1 &
server=$!
openssl req -x509 -newkey rsa:2048 -nodes -days 30 -subj /CN=127.0.0.1 -keyout "$out/key.pem" -out "$out/cert.pem" 2>/dev/null
"$bin/lodestream-server" serve --library "$LIBRARY" --listen 127.0.0.1:7982 ${CACHE_BYTES:+--cache-bytes "$CACHE_BYTES"} \
  --tls-cert "$out/cert.pem" --tls-key "$out/key.pem" >"$out/serve-tls.log" 2>&1 &
tls_server=$!
"$bin/lodestream-server" serve --library "$LIBRARY" --listen 127.0.0.1:7978 --cache-bytes 1000000 >"$out/serve-folder.log" 2>&1 &
folder_server=$!
before_server=
if [ -n "${BEFORE-}" ]; then
  "$BEFORE" serve --library "$LIBRARY" --listen 127.0.0.1:7977 ${CACHE_BYTES:+--cache-bytes "$CACHE_BYTES"} >"$out/serve-before.log" 2>&1 &
  before_server=$!
fi
nginx_conf() {
  cat <<CONF
worker_processes $(nproc);
pid $out/$1.pid;
error_log $out/$1.log;
events { worker_connections 4096; }
http {
  access_log off; sendfile on; tcp_nopush $2; tcp_nodelay on; keepalive_requests 100000000;
  open_file_cache max=100000 inactive=600s; open_file_cache_valid 600s;
  default_type application/octet-stream;
  client_body_temp_path $out/tmp; proxy_temp_path $out/tmp; fastcgi_temp_path $out/tmp; uwsgi_temp_path $out/tmp; scgi_temp_path $out/tmp;
  root $out/www; etag on; add_header Cache-Control "public, max-age=31536000, immutable";
  http2_chunk_size 128k; ssl_certificate $out/cert.pem; ssl_certificate_key $out/key.pem; ssl_protocols TLSv1.3;
  server { listen 127.0.0.1:$3 backlog=4096; }
  server { listen 127.0.0.1:$(($3 + 10)) http2; }
  server { listen 127.0.0.1:$(($3 + 20)) ssl http2; }
}
CONF
}
nginx_conf nginx on 7980 >"$out/nginx.conf"
nginx_conf nginx-push off 7981 >"$out/nginx-push.conf"
stop() {
  kill "$server" "$tls_server" "$folder_server" $before_server 2>/dev/null || true
  for name in nginx nginx-push lighttpd h2o; do
    if [ -f "$out/$name.pid" ]; then kill "$(cat "$out/$name.pid")" 2>/dev/null || true; fi
  done
}
trap stop EXIT
nginx -c "$out/nginx.conf" -p "$out"
nginx -c "$out/nginx-push.conf" -p "$out"
if command -v lighttpd >/dev/null; then
  cat >"$out/lighttpd.conf" <<CONF
server.document-root = "$out/www"
server.bind = "127.0.0.1"
server.port = 7983
server.pid-file = "$out/lighttpd.pid"
server.errorlog = "$out/lighttpd.log"
server.max-worker = $(nproc)
server.max-keep-alive-requests = 100000000
server.feature-flags = ( "server.h2proto" => "enable", "server.h2c" => "enable" )
CONF
  lighttpd -f "$out/lighttpd.conf"
fi
if command -v h2o >/dev/null; then
  cat >"$out/h2o.conf" <<CONF
listen: {host: 127.0.0.1, port: 7984}
pid-file: $out/h2o.pid
error-log: $out/h2o.log
num-threads: $(nproc)
user: $(id -un)
hosts: {default: {paths: {/: {file.dir: $out/www}}}}
CONF
  h2o -m daemon -c "$out/h2o.conf"
fi
for _ in $(seq 100); do
  kill -0 "$server" 2>/dev/null || { cat "$out/serve.log" >&2; exit 1; }
  curl -sf "$ours/readyz" >/dev/null && break
  sleep 0.1
done

python3 loadtests/servers.py "$bin/lodestream-server" "$LIBRARY" "$SCENE" "$out" "$server" "$tls_server" "$folder_server" $before_server
python3 loadtests/servers_wire.py "$out" "$server"
