#!/usr/bin/env bash
# Pages in the order of the error that they remove over all instances, against the order of the
# largest on any one: a thousand instances of one rock behind five that stand once, from a still
# camera, over three links in simulated time. Prints the error left on the screen, summed and
# largest, over the time. Needs a release build (make build). Leaves reports in target/priorities.
set -eu
cd "$(dirname "$0")/.."

bin=${CARGO_TARGET_DIR:-target}/release out=target/priorities
loadtests=$bin/lodestream-loadtests server=$bin/lodestream-server
rm -rf "$out"
mkdir -p "$out"
"$loadtests" sample crowd --out "$out/crowd.glb" --quiet
"$server" ingest "$out/crowd.glb" --library "$out/library" --scene crowd --quiet
"$loadtests" record "$out/library" --scene crowd --path loadtests/samples/crowd.path.json \
  --trace "$out/crowd.trace" --quiet
for mbps in 2 5 20; do
  for order in largest total; do
    echo "$mbps Mbps, order $order"
    "$loadtests" policies --trace "$out/crowd.trace" --pool 64 --policies decayed-error \
      --bandwidth "$mbps" --latency 40 --order "$order" --report "$out/$mbps-$order.json"
  done
done
