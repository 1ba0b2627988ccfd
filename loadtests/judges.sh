#!/usr/bin/env bash
# Holds a build against its goals: judges/__main__.py with its packages, which are put into
# target/judges/pip where they lack. `make judges`, which builds first, and `make report` call it.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
packages=$here/../target/judges/pip
export PYTHONPATH=$packages${PYTHONPATH:+:$PYTHONPATH}
if ! python3 -c 'import numpy, scipy.spatial, fast_simplification' 2>/dev/null; then
  python3 -m pip install --quiet --disable-pip-version-check --root-user-action=ignore --upgrade --target "$packages" \
    -r "$here/judges/requirements.txt" || {
    echo "needs numpy, scipy and fast-simplification: python3 with pip (package python3-pip) and the network" >&2
    exit 1
  }
fi
exec python3 "$here/judges/__main__.py" "$@"
