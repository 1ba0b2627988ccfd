#!/usr/bin/env bash
# Occlusion culling and the compute rasterizer, each alone and together: the sample city from above
# and at street level, then the default view of every model of a folder. A row a picture; pictures
# that differ from the plain one say by how many bytes. Usage: loadtests/draw.sh [FOLDER [OUT]];
# default ../shared/models and target/draw. Needs a release build.
set -eu
cd "$(dirname "$0")/.."
models=${1:-../shared/models} out=${2:-target/draw}
bin=${CARGO_TARGET_DIR:-target}/release
server=$bin/lodestream-server client=$bin/lodestream-client loadtests=$bin/lodestream-loadtests
library=$out/library
mkdir -p "$out"

# The first number of a key in a report.
figure() { sed -n "s/^ *\"$1\": *\([0-9.]*\).*/\1/p" "$2" | head -n 1; }

# row NAME SCENE PICTURE OPTION...
row() {
  name=$1 scene=$2 picture=$3
  shift 3
  file=$out/$name-$picture
  "$client" render "$library" --scene "$scene" --size 960x540 --repeat 5 --out "$file.png" --report "$file.json" --quiet "$@"
  differs=$(cmp -l "$out/$name-plain.png" "$file.png" 2>/dev/null | wc -l)
  printf '%-24s %-10s %9s triangles %6s clusters %6s by compute %4s pages %9s bytes %7.2f s %7.0f ms %s\n' \
    "$name" "$picture" "$(figure triangles "$file.json")" "$(figure clusters "$file.json")" \
    "$(figure clusters_software "$file.json")" "$(figure pages_fetched "$file.json")" \
    "$(figure bytes_fetched "$file.json")" "$(figure settled_secs "$file.json")" "$(figure p50 "$file.json")" \
    "$([ "$differs" = 0 ] && echo equal || echo differs)"
}

rows() {
  name=$1 scene=$2
  shift 2
  row "$name" "$scene" plain --no-occlusion --raster hardware "$@"
  row "$name" "$scene" occlusion --raster hardware "$@"
  row "$name" "$scene" compute --no-occlusion "$@"
  row "$name" "$scene" both "$@"
}

"$loadtests" sample city --instances 1200 --out "$out/city.glb" >"$out/city.txt"
"$server" ingest "$out/city.glb" --library "$library" --scene city --quiet
rows above city --camera "eye=210,100,225;target=0,22,-6;fov=42"
rows street city --camera "eye=0,2,40;target=60,6,-40;fov=60"
for file in "$models"/*.glb; do
  [ -e "$file" ] || { echo "SKIPPED: models of $models, which has none"; break; }
  name=$(basename "$file" .glb)
  "$server" ingest "$file" --library "$library" --scene "$name" --quiet 2>>"$out/ingest.txt"
  rows "$name" "$name"
done
