#!/usr/bin/env python3
"""Holds a build against its goals: `make judges`. A row a model of ../shared/models.

Errors of cuts against exact distances and a plain simplifier, the default view at one pixel, what
groups store over what is measured, foliage at several sizes, and rocks of any size.
SERVER, CLIENT and LOADTESTS name the programs; the release build by default."""

import argparse
import json
import shutil
import sys
import time
from functools import partial
from pathlib import Path

sys.dont_write_bytecode = True
import before as earlier
import check
import errors
import inputs
import promises
import table
import views
from floor import Floors
from programs import MODELS, ROOT, Failed, Programs, from_environment

PARTS = ("errors", "view", "promises", "curve", "foliage", "rocks")
FOLIAGE = ("japanese_maple", "black_forest")
# Scenes of more instances have no curve and are drawn once a size: they take minutes without a GPU.
MOST_DRAWN_OFTEN = 100
say = partial(print, flush=True)


def arguments() -> argparse.Namespace:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--folder", type=Path, default=ROOT / "target" / "judges", help="library, pictures and made inputs")
    options.add_argument("--floors", type=Path, help="curves of the plain simplifier, kept between runs")
    options.add_argument("--out", type=Path, help="all figures as JSON")
    options.add_argument("--before", type=Path, help="figures of another run, to stand beside")
    options.add_argument("--slim", type=Path, help="figures without those of this machine, for keeping as --before")
    options.add_argument("--add", action="store_true", help="keep the figures that --out has already, but for those measured now")
    options.add_argument("--parts", default=",".join(PARTS), help="of " + ",".join(PARTS))
    options.add_argument("--rocks", default=str(inputs.ROCK_MILLIONS), help="sizes of the rocks, millions of triangles: 1,100")
    options.add_argument("models", nargs="*", help="files, or names in ../shared/models")
    asked = options.parse_args()
    asked.parts = asked.parts.split(",")
    if unknown := set(asked.parts) - set(PARTS):
        options.error(f"--parts: expected some of {','.join(PARTS)}, found {','.join(sorted(unknown))}")
    asked.rocks = [float(it) for it in asked.rocks.split(",") if it]
    asked.floors = asked.floors or asked.folder / "floors.json"
    asked.out = asked.out or asked.folder / "judges.json"
    asked.models = [Path(it) if Path(it).suffix else MODELS / f"{it}.glb" for it in asked.models] or sorted(MODELS.glob("*.glb"))
    return asked


class Run:
    """Figures as they come, written after each: a run that ends early has shown something."""

    def __init__(self, asked: argparse.Namespace, programs: Programs):
        self.asked, self.programs = asked, programs
        self.figures = {"models": {}, "foliage": {}, "rocks": {}, "failed": []}
        if asked.add and asked.out.exists():
            self.figures |= json.loads(asked.out.read_text())
        self.pictures = programs.folder / "pictures"
        self.pictures.mkdir(exist_ok=True)

    def keep(self) -> None:
        """With the lists that `lodestream-loadtests report` and --before read."""
        models = self.figures["models"].items()
        self.figures["rows"] = [table.flat(*it) for it in models]
        self.figures["cuts"] = [it for _, model in models for it in model.get("errors", ())]
        self.figures["curves"] = [{"model": name, **it} for name, model in models for it in model.get("curve", ())]
        self.asked.out.write_text(json.dumps(self.figures, indent=1))

    def tried(self, place: str, measure) -> None:
        """A failure is named and counts at the end: what comes after it is measured still."""
        try:
            measure()
        except (Failed, OSError, ValueError) as error:
            self.figures["failed"].append(f"{place}: {error}")
            say(f"NOT {place}: {error}")
        self.keep()

    def model(self, file: Path) -> None:
        name, started = file.stem, time.monotonic()
        model = self.figures["models"].setdefault(name, {})
        model["build"] = self.programs.ingest(file, name)
        if "errors" in self.asked.parts:
            floors = Floors(self.asked.floors)
            model["errors"] = [it.json() for it in errors.rows(self.programs, floors, name, say)]
        if "view" in self.asked.parts:
            model["view"] = views.view(self.programs, name, self.pictures).json()
        if "promises" in self.asked.parts:
            model["promises"] = promises.promises(self.programs, name)
        if "curve" in self.asked.parts and model["build"]["instances"] <= MOST_DRAWN_OFTEN:
            model["curve"] = views.curve(self.programs, name)
        say(f"{table.cells(table.flat(name, model))}  ({time.monotonic() - started:.0f} s)")

    def foliage(self, name: str, file: Path) -> None:
        again = self.programs.ingest(file, name)["instances"] <= MOST_DRAWN_OFTEN
        found = self.figures["foliage"][name] = []
        for size in views.FOLIAGE_SIZES:
            view = views.foliage(self.programs, name, self.pictures, size, again).json()
            found.append(view)
            say(table.view_row(name, view))

    def rock(self, millions: float) -> None:
        file = inputs.rock(self.programs.folder, millions)
        build = self.programs.ingest(file, file.stem, "--memory-limit", "2GiB")
        # Full detail of a large rock is more than a software adapter draws.
        view = views.view(self.programs, file.stem, self.pictures, compared=millions <= 2).json()
        self.figures["rocks"][file.stem] = {"build": build, "view": view}
        say(table.view_row(file.stem, view))


def main() -> None:
    asked = arguments()
    check.all_hold()
    programs = from_environment(asked.folder)
    shutil.rmtree(programs.library, ignore_errors=True)
    run = Run(asked, programs)
    run.keep()
    before = json.loads(asked.before.read_text()) if asked.before else None
    if not MODELS.is_dir():
        say(f"SKIPPED: models, trees and rocks of {MODELS}, which is not there")
        asked.rocks = []
    if any(it in asked.parts for it in PARTS[:4]):
        say(errors.HEAD if "errors" in asked.parts else table.head())
        for file in asked.models:
            run.tried(file.stem, partial(run.model, file))
    if "foliage" in asked.parts:
        trees = [MODELS / f"{it}.glb" for it in FOLIAGE]
        for file in [it for it in trees if it in asked.models] + inputs.crowns(programs.folder):
            run.tried(f"foliage {file.stem}", partial(run.foliage, file.stem, file))
    if "rocks" in asked.parts:
        for millions in asked.rocks:
            run.tried(f"rock {millions:g}", partial(run.rock, millions))
    shutil.rmtree(programs.library, ignore_errors=True)
    say()
    say(table.head())
    for row in run.figures["rows"]:
        say(table.cells(row))
    say(table.LEGEND)
    if before:
        say("\n" + "\n".join(earlier.side_by_side(run.figures, before)))
    say(f"\n{'goal':64s} {'wanted':>14s} {'found':>9s}")
    say("\n".join(table.goals(run.figures) + (earlier.goals(run.figures, before) if before else [])))
    say(f"figures: {asked.out}")
    if asked.slim:
        asked.slim.write_text(earlier.written(earlier.rounded(earlier.slim(run.figures))))
    if run.figures["failed"]:
        sys.exit("not measured: " + "; ".join(run.figures["failed"]))


if __name__ == "__main__":
    main()
