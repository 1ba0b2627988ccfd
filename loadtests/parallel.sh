#!/usr/bin/env bash
# One ingest as jobs under GNU parallel, one of them killed, against the same ingest in one run: both must publish the same scene.
# Usage: loadtests/parallel.sh [INPUT...]; default a sample city. JOBS (default 8) jobs, as many at once as there are cores.
# Needs a release build (make build). Leaves reports in target/parallel.
set -eu
calling=$PWD
cd "$(dirname "$0")/.."

jobs=${JOBS:-8}
bin=${CARGO_TARGET_DIR:-target}/release out=target/parallel
server=$bin/lodestream-server
if [ ! -x "$server" ]; then
  echo "expected $server, found none: run 'make build' first" >&2
  exit 1
fi

if ! command -v parallel >/dev/null 2>&1; then
  as_root=""
  [ "$(id -u)" = 0 ] || as_root="sudo -n"
  if ! command -v apt-get >/dev/null 2>&1 || ! $as_root apt-get install -y -qq parallel >/dev/null 2>&1; then
    echo "GNU parallel is missing: install it, on Debian and Ubuntu with 'apt-get install parallel', and try again" >&2
    exit 1
  fi
fi

rm -rf "$out"
mkdir -p "$out"
inputs=()
for input in "$@"; do
  case $input in /*) inputs+=("$input") ;; *) inputs+=("$calling/$input") ;; esac
done
if [ $# = 0 ]; then
  "$bin/lodestream-loadtests" sample city --instances 4000 --unique 64 --out "$out/city.glb" --quiet
  inputs=("$out/city.glb")
fi

step() { printf '\n== %s\n' "$1"; }
scene_hash() { "$server" list --library "$1" | cut -f 2; }
planned=(ingest --library "$out/jobs" --scene sample --quiet)

step "one run"
"$server" ingest "${inputs[@]}" --library "$out/plain" --scene sample --report "$out/plain.json"

step "plan"
"$server" ingest "${inputs[@]}" --library "$out/jobs" --scene sample --plan --jobs "$jobs" --report "$out/plan.json"

step "job 0, killed; its plan cannot be finished"
"$server" "${planned[@]}" --job 0 --threads 1 &
# Once it has built a mesh.
until [ -n "$(find "$out/jobs/builds" -type f 2>/dev/null | head -n 1)" ] || ! kill -0 $! 2>/dev/null; do sleep 0.05; done
kill -KILL $! 2>/dev/null || true
wait $! 2>/dev/null || true
if "$server" "${planned[@]}" --finish; then
  echo "expected --finish to name the jobs that are missing, found a scene" >&2
  exit 1
fi

step "all jobs, one thread each, under GNU parallel"
parallel --will-cite -q --joblog "$out/joblog" \
  "$server" ingest --library "$out/jobs" --scene sample --job {} --threads 1 --report "$out/job-{}.json" ::: $(seq 0 $((jobs - 1)))

step "finish"
"$server" ingest --library "$out/jobs" --scene sample --finish --report "$out/finish.json"

one=$(scene_hash "$out/plain") many=$(scene_hash "$out/jobs")
printf '\none run  %s\njobs     %s\n' "$one" "$many"
if [ -z "$one" ] || [ "$one" != "$many" ]; then
  echo "expected the same scene, found another" >&2
  exit 1
fi
"$server" verify --library "$out/jobs"
