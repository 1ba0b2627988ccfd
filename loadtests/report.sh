#!/usr/bin/env bash
# Error against run time for the sample scenes: builds, pictures over a range of pixel errors, paths over links, policies over pools.
# Called by `make report`, which builds first; writes target/report/index.html with the JSON beside it.
set -eu
cd "$(dirname "$0")/.."

bin=${CARGO_TARGET_DIR:-target}/release
out=target/report
server=$bin/lodestream-server client=$bin/lodestream-client loadtests=$bin/lodestream-loadtests
rm -rf "$out"
mkdir -p "$out"

"$loadtests" sample rock --out "$out/rock.glb"
cp loadtests/samples/belweder.glb "$out/"
for scene in belweder rock; do
  "$server" ingest "$out/$scene.glb" --library "$out/library" --scene "$scene" --report "$out/build-$scene.json"
  picture() { "$client" render "$out/library" --scene "$scene" --size 640x360 "$@" --quiet; }
  picture --reference --out "$out/$scene-reference.png" --depth "$out/$scene-reference.pfm"
  for px in 0.25 0.5 1 2 4 8 16; do
    name=$scene@$px
    picture --pixel-error "$px" --out "$out/$name.png" --depth "$out/$name.pfm" --report "$out/draw-$name.json"
    "$loadtests" compare "$out/$name.png" "$out/$scene-reference.png" --depths "$out/$name.pfm" "$out/$scene-reference.pfm" \
      --report "$out/compare-$name.json"
  done
  "$client" play "$out/library" --scene "$scene" --path "loadtests/samples/$scene.path.json" --trace "$out/$scene.trace" \
    --report "$out/play-$scene.json"
  "$loadtests" policies --trace "$out/$scene.trace" --pool 2,3,4,6,8 --report "$out/policies-$scene.json" --quiet
done

# A city from above and at street level, and a hundred thousand instances far away.
"$loadtests" sample city --instances 1200 --out "$out/city.glb" >"$out/city.txt"
"$loadtests" sample city --instances 100000 --out "$out/crowd.glb" >>"$out/city.txt"
for scene in city crowd; do
  "$server" ingest "$out/$scene.glb" --library "$out/library" --scene "$scene" --report "$out/build-$scene.json" --quiet
done
rm -f "$out/crowd.glb"
# curve NAME SCENE OPTION...: pictures over pixel errors, against the one of the full detail.
curve() {
  name=$1 scene=$2
  shift 2
  picture() { "$client" render "$out/library" --scene "$scene" --size 640x360 "$@" --quiet; }
  picture "$@" --reference --out "$out/$name-reference.png" --depth "$out/$name-reference.pfm"
  for px in 0.25 0.5 1 2 4 8 16; do
    file=$name@$px
    picture "$@" --pixel-error "$px" --repeat 3 --out "$out/$file.png" --depth "$out/$file.pfm" --report "$out/draw-$file.json"
    "$loadtests" compare "$out/$file.png" "$out/$name-reference.png" --depths "$out/$file.pfm" "$out/$name-reference.pfm" \
      --report "$out/compare-$file.json"
  done
}
curve above city --camera "eye=210,100,225;target=0,22,-6;fov=42"
curve street city --camera "eye=0,2,40;target=60,6,-40;fov=60"
# A reference of all its triangles would take minutes.
for px in 0.5 1 2 4 8 16; do
  "$client" render "$out/library" --scene crowd --size 640x360 --pixel-error "$px" --repeat 3 --quiet \
    --out "$out/crowd@$px.png" --report "$out/draw-crowd@$px.json"
done
rm -f "$out"/*.pfm

# Against the rival, and where it is hard. A row that does not hold is in the page; it does not stop the report.
"$loadtests" build "$out/belweder.glb" "$out/rock.glb" --generate torus:100000 sphere:100000 charts:30000 facet:30000 foliage:30000 \
  --largest 1 --runs 3 --samples 100000 --report "$out/builders-all.json"
"$loadtests" build --generate torus:30000 --no-memory --knobs --samples 100000 --report "$out/builders-knobs.json" --quiet
"$loadtests" pages "$out/belweder.glb" "$out/rock.glb" --report "$out/pages-all.json"
"$loadtests" pages --generate torus:100000 --bits 10,11,12,13,14,15,16,17,18,19,20 --report "$out/pages-bits.json" --quiet
"$loadtests" stability --report "$out/stability-all.json" || echo "some rows of the stability table do not hold"
ROWS=made CLAIMS="$out/stability-scenes.json" loadtests/cases/__main__.py || echo "some generated scenes do not hold"
loadtests/cases/sheets.py "$out"

# Triangles and bytes over the error, beside those of the builder before simplification by error.
judged=("$out/belweder.glb" "$out/rock.glb")
for model in stanford_dragon hotel_room apartment japanese_maple; do
  [ ! -e "../shared/models/$model.glb" ] || judged+=("$model")
done
loadtests/judges.sh --folder target/judges --out "$out/judges-now.json" --parts errors,view,curve "${judged[@]}" >"$out/judges.txt" ||
  echo "some models could not be judged"
for model in "${judged[@]}"; do
  cp "target/judges/pictures/$(basename "$model" .glb)"-960x540*.png "$out/"
done
cp loadtests/judges/before.json "$out/judges-before.json"
"$loadtests" report "$out"
