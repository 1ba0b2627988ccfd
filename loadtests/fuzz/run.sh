#!/usr/bin/env bash
# Fuzzes every parser that network or disk reaches, SECS (60) each: `loadtests/fuzz/run.sh [SECS [TARGET…]]`. Needs Rust and a C++
# compiler. What breaks a target is kept in target/fuzz/artifacts; exits 1 where there is anything. Again, with one such file:
# `target/fuzz/build/HOST/release/TARGET FILE`.
#
#   JOBS=1    targets at once
#   MERGE=1   afterwards the corpus here becomes the fewest inputs, up to 4 KiB, that reach all that was reached
set -eu
cd "$(dirname "$0")"
mkdir -p ../../target/fuzz/artifacts ../../target/fuzz/logs ../../target/fuzz/tmp
out=$(realpath ../../target/fuzz)
secs=${1:-60}
[ $# -eq 0 ] || shift
targets=${*:-$(cd fuzz_targets && ls | sed 's/\.rs$//' | grep -v '^seeds$')}

host=$(rustc -vV | sed -n 's/^host: //p')
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$out/build}
bin=$CARGO_TARGET_DIR/$host/release
flags=-Cpasses=sancov-module
for flag in level=4 inline-8bit-counters pc-table trace-compares; do
  flags+=" -Cllvm-args=-sanitizer-coverage-$flag"
done
[ Cargo.lock -nt ../../Cargo.lock ] || cp ../../Cargo.lock Cargo.lock
# With a target build scripts go without the flags.
RUSTFLAGS="$flags --cfg fuzzing" ${CARGO:-cargo} build --release --target "$host"

export TMPDIR=$out/tmp RAYON_NUM_THREADS=1 RUST_BACKTRACE=1
SEEDS=$out/seeds "$bin/seeds" >/dev/null 2>&1
limits="-timeout=10 -rss_limit_mb=1024 -malloc_limit_mb=512 -max_len=8192 -detect_leaks=0 -reload=0"

fuzz() {
  mkdir -p "$out/corpus/$1" "$out/seeds/$1" "corpus/$1"
  awk -v own="# $1" '/^# / { inside = $0 == own; next } inside { gsub(/"/, "\\x22"); for (i = 1; i <= NF; i++) print "\"" $i "\"" }' \
    words.dict >"$out/$1.dict"
  dict=
  [ ! -s "$out/$1.dict" ] || dict=-dict=$out/$1.dict
  "$bin/$1" "$out/corpus/$1" "corpus/$1" "$out/seeds/$1" $limits $dict -max_total_time="$secs" \
    -artifact_prefix="$out/artifacts/$1-" -print_final_stats=1 >"$out/logs/$1" 2>&1 || echo "$1" >>"$out/broken"
  [ "${MERGE:-}" != 1 ] || merge "$1"
}

merge() {
  rm -rf "$out/merge/$1"
  mkdir -p "$out/merge/$1/small" "$out/merge/$1/fewest"
  find "$out/corpus/$1" "corpus/$1" "$out/seeds/$1" -type f -size -9 -exec cp {} "$out/merge/$1/small" \;
  "$bin/$1" -set_cover_merge=1 -use_counters=0 $limits "$out/merge/$1/fewest" "$out/merge/$1/small" >"$out/logs/$1-merge" 2>&1
  rm -rf "corpus/$1"
  mv "$out/merge/$1/fewest" "corpus/$1"
}

rm -f "$out/broken"
export -f fuzz merge
export out secs bin limits
printf '%s\n' $targets | xargs -P "${JOBS:-1}" -I{} bash -euc 'fuzz {}'
printf '%-14s %11s %7s %7s %s\n' target executions edges inputs
for target in $targets; do
  log=$out/logs/$target
  printf '%-14s %11s %7s %7s %s\n' "$target" \
    "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" \
    "$(grep -o 'cov: [0-9]*' "$log" | tail -1 | cut -c6-)" "$(ls "corpus/$target" | wc -l)" \
    "$(! grep -qx "$target" "$out/broken" 2>/dev/null || grep -m1 -E 'panicked|ERROR|SUMMARY' "$log")"
done
rm -rf "$out/tmp"
[ ! -e "$out/broken" ] || { echo "see $out/artifacts and $out/logs"; exit 1; }
