#!/usr/bin/env bash
# The whole line on this machine: sample scenes -> library -> HTTP -> streamed camera paths -> pictures and a report.
# Called by `make demo`, which builds first.
set -eu
cd "$(dirname "$0")/.."

bin=${CARGO_TARGET_DIR:-target}/release
out=target/demo
library=$out/library
started=$(date +%s)
server=$bin/lodestream-server client=$bin/lodestream-client loadtests=$bin/lodestream-loadtests

rm -rf "$out"
mkdir -p "$out/frames"
step() { printf '\n== %s (%d s)\n' "$1" "$(($(date +%s) - started))"; }

step "making a city of many instances, and a rock"
"$loadtests" sample city --instances 1200 --out "$out/city.glb"
"$loadtests" sample rock --out "$out/rock.glb"

step "ingesting: clusters, hierarchy, pages"
for scene in belweder city rock; do
  file=$out/$scene.glb
  [ "$scene" = belweder ] && file=loadtests/samples/belweder.glb
  "$server" ingest "$file" --library "$library" --scene "$scene" --report "$out/build-$scene.json"
done
"$server" list --library "$library"

step "serving on loopback"
"$server" serve --library "$library" --listen 127.0.0.1:0 >"$out/serve.out" 2>"$out/serve.err" &
server_pid=$!
trap 'kill "$server_pid" 2>/dev/null; wait "$server_pid" 2>/dev/null || true' EXIT
for _ in $(seq 100); do
  grep -q 'listening on' "$out/serve.out" && break
  kill -0 "$server_pid" 2>/dev/null || { cat "$out/serve.err" >&2; exit 1; }
  sleep 0.1
done
url=$(sed -n 's/^listening on //p' "$out/serve.out")
echo "$url"

step "pictures, streamed over HTTP"
above="eye=210,100,225;target=0,22,-6;fov=42"
"$client" render "$url" --scene city --camera "$above" --size 960x540 --out "$out/city.png" --report "$out/draw-city@1.json"
for scene in belweder rock; do
  "$client" render "$url" --scene "$scene" --size 960x540 --out "$out/$scene.png" --depth "$out/$scene.pfm" --report "$out/draw-$scene@1.json"
done
for scene in belweder rock; do
  "$client" render "$url" --scene "$scene" --size 960x540 --reference --out "$out/$scene-reference.png" --depth "$out/$scene-reference.pfm" --quiet
  echo "$scene against full detail:"
  "$loadtests" compare "$out/$scene.png" "$out/$scene-reference.png" --depths "$out/$scene.pfm" "$out/$scene-reference.pfm" --report "$out/compare-$scene@1.json"
done
"$client" render "$url" --scene belweder --size 960x540 --mode clusters --out "$out/belweder-clusters.png" --quiet
"$client" render "$url" --scene city --camera "$above" --size 960x540 --mode levels --out "$out/city-levels.png" --quiet

step "camera paths, streamed over HTTP"
for scene in belweder city; do
  mkdir -p "$out/frames/$scene"
  "$client" play "$url" --scene "$scene" --path "loadtests/samples/$scene.path.json" --frames "$out/frames/$scene" \
    --trace "$out/$scene.trace" --report "$out/play-$scene.json"
done

step "eviction policies on the recorded trace, and viewers at once"
"$loadtests" policies --trace "$out/city.trace" --pool 2,3,4,6,8,12 --report "$out/policies-city.json"
"$loadtests" load "$url" --viewers 24 --seconds 10 --report "$out/load-viewers.json"

step "report"
"$loadtests" report "$out"

cat <<END

Done in $(($(date +%s) - started)) seconds.
  pictures   $out/*.png, frames of the camera paths in $out/frames/
  report     $out/index.html
  look around yourself:
    $server serve --library $library --listen 127.0.0.1:7878 &
    $client view http://127.0.0.1:7878 --scene city
END
