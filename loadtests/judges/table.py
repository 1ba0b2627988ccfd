"""A row a model, and the goals beside."""

from statistics import median

import errors

# Heading, key of the flat row, format.
COLUMNS = (
    ("model", "model", "22s"), ("used", "used", "6.2f"), ("max", "largest", "6.3f"), ("ratio", "ratio_judged", "6.2f"), ("cut tri", "triangles", "9d"),
    ("tri/px", "triangles_a_pixel", "6.2f"), ("MB", "megabytes", "7.3f"), ("pages", "pages", "5d"), ("PSNR", "psnr_db", "5.1f"), ("p50", "p50", "5.2f"),
    ("p95", "p95", "6.2f"), ("over", "unbounded", "4d"), ("groups", "measured", "6d"), ("build s", "build_secs", "7.2f"),
)  # fmt: skip
LEGEND = (
    "used, max: largest distance / E (median over four errors by 3,000 samples; most by all points); ratio: triangles at E / plain simplifier's; "
    "cut tri, tri/px, MB (textures apart), pages, PSNR: the default view at 1 px; p50, p95, over: stored / measured of groups, groups that exceed"
)


def geometric_mean(values) -> float | None:
    values = [it for it in values if it]
    return errors.geometric_mean(values)


def flat(name: str, model: dict) -> dict:
    """What the table shows of a model."""
    row = {"model": name}
    if found := model.get("errors"):
        row |= {
            "used": median(it["judged"] for it in found),
            "largest": max(it["largest"] for it in found),
            "ratio_judged": geometric_mean(it["ratio_judged"] for it in found),
            "cut_triangles": [it["triangles"] for it in found],
        }
    if view := model.get("view"):
        row |= {it: view[it] for it in ("triangles", "triangles_a_pixel", "bytes", "pages", "psnr_db", "psnr_covered_db", "pool_bytes")}
        row["megabytes"] = view["bytes"] / 1e6
    if promises := model.get("promises"):
        row |= {it: promises[it] for it in ("p50", "p95", "unbounded", "measured", "worst_excess")}
    if build := model.get("build"):
        row["build_secs"] = build.get("seconds", {}).get("build")
        row["stored_bytes"] = build["bytes"]["stored"]
        row["pages_built"] = build["pages"]
    return row


def cells(row: dict) -> str:
    shown = []
    for _, key, form in COLUMNS:
        value, width = row.get(key), form.rstrip("sdf").split(".")[0]
        shown.append(f"{value:{form}}" if value is not None else f"{'-':>{width}s}")
    return " ".join(shown)


def head() -> str:
    names = []
    for name, _, form in COLUMNS:
        width = form.rstrip("sdf").split(".")[0]
        names.append(f"{name:{'<' if form.endswith('s') else '>'}{width}s}")
    return " ".join(names)


def goal(text: str, wanted: str, found: float | None, holds: bool | None) -> str:
    mark = {True: "holds", False: "NOT", None: "-"}[holds]
    return f"{text:64s} {wanted:>14s} {'-' if found is None else f'{found:.3g}':>9s} {mark}"


def at_most(text: str, bound: float, found: float | None) -> str:
    return goal(text, f"at most {bound:g}", found, None if found is None else found <= bound)


def at_least(text: str, bound: float, found: float | None) -> str:
    return goal(text, f"at least {bound:g}", found, None if found is None else found >= bound)


def simplified_well(cuts: list[dict]) -> list[dict]:
    """The plain simplifier eats open edges, and little error is left for the rest."""
    well = {it["model"] for it in cuts if it["share"] == max(errors.SHARES) and it["plain_judged"] and it["plain_judged"] < it["source"] / 10}
    return [it for it in cuts if it["model"] in well]


def goals(run: dict) -> list[str]:
    """The goals of the run alone, as far as it has their figures."""
    rows, found, lines = run["rows"], run["cuts"], []
    if found:
        lines += [
            at_most("largest distance / E, all points", 1, max(it["largest"] for it in found)),
            at_least("distance / E by 3,000 samples, median", 0.6, median(it["judged"] for it in found)),
            at_least("the same, least median of a model", 0.4, min(it["used"] for it in rows if "used" in it)),
            at_most("triangles at E / plain simplifier, geometric mean", 1.5, geometric_mean(it["ratio_judged"] for it in found)),
            at_most("the same, worst model", 1.5, max((it["ratio_judged"] for it in rows if it.get("ratio_judged")), default=None)),
            at_most("the same, models of which it leaves below a tenth at 1e-2", 1.5, geometric_mean(it["ratio_judged"] for it in simplified_well(found))),
            at_most("the same by all points", 1.5, geometric_mean(it["ratio"] for it in found)),
            at_most("the same at equal distance", 1.5, geometric_mean(it["ratio_equal"] for it in found)),
        ]
    measured = [it for it in rows if it.get("p50") is not None]
    if measured:
        lines += [
            at_most("stored / measured, p50, median model", 1.25, median(it["p50"] for it in measured)),
            at_most("the same, worst model", 1.25, max(it["p50"] for it in measured)),
            at_most("stored / measured, p95, median model", 2, median(it["p95"] for it in measured)),
            at_most("the same, worst model", 2, max(it["p95"] for it in measured)),
            at_most("groups that exceed, share", 0.0005, sum(it["unbounded"] for it in measured) / sum(it["measured"] for it in measured)),
        ]
    psnr = [it["psnr_db"] for it in rows if "psnr_db" in it]
    if psnr:
        # Equal pictures have no figure.
        lines.append(at_most("models whose picture at 1 px is below 40 dB", 1, sum(it is not None and it < 40 for it in psnr)))
    rocks = run.get("rocks", {})
    for name, rock in rocks.items():
        lines.append(at_most(f"{name}: triangles a covered pixel", 4, rock["view"]["triangles_a_pixel"]))
    if len(rocks) > 1:
        small, large = (rocks[it]["view"] for it in sorted(rocks, key=lambda it: rocks[it]["build"]["input_triangles"])[:: len(rocks) - 1])
        for key in ("triangles", "bytes"):
            lines.append(at_most(f"largest rock / smallest rock, {key}", 1.3, large[key] / small[key]))
    views = [it for views in run.get("foliage", {}).values() for it in views]
    if views:
        lines += [
            at_most("foliage: most triangles a covered pixel", 4, max(it["triangles_a_pixel"] for it in views)),
            at_most("foliage: crown cover off by at most", 0.05, max(abs(it["cover"] - 1) for it in views)),
        ]
    return lines


def view_row(name: str, view: dict) -> str:
    cover = f"{view['cover']:.3f}" if view.get("cover") else "-"
    decibels = f"{view['psnr_db']:.1f} dB" if view.get("psnr_db") else "-"
    return (
        f"{name:22s} {view['size'][0]:4d}x{view['size'][1]:<4d} {view['triangles']:9d} triangles {view['covered_px']:7d} px  "
        f"{view['triangles_a_pixel']:7.2f} a px  {view['bytes'] / 1e6:7.2f} MB {view['pages']:5d} pages  cover {cover} {decibels}"
    )
