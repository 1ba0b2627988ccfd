#!/usr/bin/env bash
# Every model of a folder: ingest, serve, `render --pixel-error 1` against `render --reference`, one row each.
# Usage: loadtests/models.sh [FOLDER [OUT]]; default ../shared/models and target/models. Needs a release build.
set -eu
cd "$(dirname "$0")/.."
models=${1:-../shared/models} out=${2:-target/models}
bin=${CARGO_TARGET_DIR:-target}/release
server=$bin/lodestream-server client=$bin/lodestream-client loadtests=$bin/lodestream-loadtests
mkdir -p "$out"

for file in "$models"/*.glb; do
  name=$(basename "$file" .glb)
  "$server" ingest "$file" --library "$out/library" --scene "$name" --quiet --report "$out/build-$name.json"
done

"$server" serve --library "$out/library" --listen 127.0.0.1:0 >"$out/serve.out" 2>"$out/serve.err" &
server_pid=$!
trap 'kill "$server_pid" 2>/dev/null; wait "$server_pid" 2>/dev/null || true' EXIT
until grep -q 'listening on' "$out/serve.out"; do
  kill -0 "$server_pid" 2>/dev/null || { cat "$out/serve.err" >&2; exit 1; }
  sleep 0.1
done
url=$(sed -n 's/^listening on //p' "$out/serve.out")

failed=0
for file in "$models"/*.glb; do
  name=$(basename "$file" .glb)
  if "$client" render "$url" --scene "$name" --size 960x540 --pixel-error 1 --out "$out/$name.png" --depth "$out/$name.pfm" \
      --report "$out/draw-$name@1.json" --quiet &&
    "$client" render "$url" --scene "$name" --size 960x540 --reference --out "$out/$name-reference.png" \
      --depth "$out/$name-reference.pfm" --quiet; then
    printf '%-24s ' "$name"
    "$loadtests" compare "$out/$name.png" "$out/$name-reference.png" --depths "$out/$name.pfm" "$out/$name-reference.pfm" \
      --report "$out/compare-$name@1.json"
  else
    echo "$name: failed"
    failed=1
  fi
done
"$loadtests" report "$out"
exit "$failed"
