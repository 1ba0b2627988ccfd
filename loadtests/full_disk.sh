#!/usr/bin/env bash
# Ingests into stores that are too small: `make kills` runs this after the kills. In a mount namespace of its own, so it needs no root where
# the system allows namespaces; says SKIPPED where it does not.
#
#   full_disk.sh SERVER_BINARY FOLDER   (FOLDER as kills.py left it)
set -eu
if [ "${INSIDE-}" != yes ]; then
  unshare -rm true 2>/dev/null || { echo "SKIPPED: full disks (this system lets nobody mount)"; exit 0; }
  INSIDE=yes exec unshare -rm "$0" "$(realpath "$1")" "$(realpath "$2")"
fi
server=$1 folder=$2
mkdir -p "$folder/small"
full=0 fitted=0
for kib in $(seq 60 8 420); do
  mount -t tmpfs -o "size=${kib}k" none "$folder/small"
  library=$folder/small/library
  if ! "$server" ingest "$folder/base.obj" --library "$library" --scene base -q 2>"$folder/said"; then
    grep -q "No space left" "$folder/said" || { echo "$kib KiB: expected \"No space left\", found:"; cat "$folder/said"; exit 1; }
    umount "$folder/small"
    continue
  fi
  if "$server" ingest "$folder/1.obj" --library "$library" --scene edited -q 2>"$folder/said"; then
    fitted=$((fitted + 1))
  else
    grep -q "No space left" "$folder/said" || { echo "$kib KiB: expected \"No space left\", found:"; cat "$folder/said"; exit 1; }
    full=$((full + 1))
  fi
  "$server" verify --library "$library" -q || { echo "$kib KiB: verify after a full disk"; exit 1; }
  "$server" show base --library "$library" -q >/dev/null || { echo "$kib KiB: base is gone"; exit 1; }
  # With room again the same command comes to its end.
  mount -o remount,size=20m "$folder/small"
  "$server" ingest "$folder/1.obj" --library "$library" --scene edited -q
  "$server" verify --library "$library" -q
  umount "$folder/small"
done
echo "full disks: $full ingests stopped by one, $fitted that fitted; after each the library was whole, and with room the ingest came to its end"
[ "$full" -gt 0 ] && [ "$fitted" -gt 0 ] || { echo "expected some of both"; exit 1; }
