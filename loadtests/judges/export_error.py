#!/usr/bin/env python3
"""Only the cuts' errors: export_error.py [--floors FILE.json] [--out FILE.json] MODEL...

SERVER names the binary; a MODEL is a file, or a name in ../shared/models."""

import argparse
import json
import sys
from functools import partial
from pathlib import Path

sys.dont_write_bytecode = True
import errors
from floor import Floors
from programs import MODELS, ROOT, from_environment


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--folder", type=Path, default=ROOT / "target" / "judges")
    options.add_argument("--floors", type=Path)
    options.add_argument("--out", type=Path)
    options.add_argument("models", nargs="*")
    asked = options.parse_args()
    programs = from_environment(asked.folder)
    floors = Floors(asked.floors or asked.folder / "floors.json")
    say = partial(print, flush=True)
    say(errors.HEAD)
    found = []
    for name in asked.models or sorted(it.stem for it in MODELS.glob("*.glb")):
        file = Path(name) if Path(name).suffix else MODELS / f"{name}.glb"
        built = programs.ingest(file, file.stem)
        say(f"{file.stem}: built in {built['seconds']['build']:.1f} s, {built['bytes']['stored'] / 1e6:.1f} MB")
        found += errors.rows(programs, floors, file.stem, say)
        if asked.out:
            asked.out.write_text(json.dumps({"rows": [it.json() for it in found]}, indent=1))
    for line in errors.said(errors.summary(found)):
        say(line)


if __name__ == "__main__":
    main()
