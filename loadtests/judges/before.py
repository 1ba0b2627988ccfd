"""Two runs side by side."""

import json

from errors import SHARES
from table import at_most, geometric_mean

# Heading and key of the flat row.
SIDE = (
    ("cut tri", "triangles"), ("bytes", "bytes"), ("pages", "pages"), ("pool", "pool_bytes"), ("used", "used"),
    ("ratio", "ratio_judged"), ("p50", "p50"), ("p95", "p95"), ("stored", "stored_bytes"), ("build s", "build_secs"),
)  # fmt: skip


def rows(figures: dict) -> dict[str, dict]:
    return {it["model"]: it for it in figures["rows"]}


def changes(run: dict, before: dict, key: str) -> dict[str, float]:
    """After over before a model."""
    earlier = rows(before)
    both = {name: (row.get(key), earlier.get(name, {}).get(key)) for name, row in rows(run).items()}
    return {name: pair[0] / pair[1] for name, pair in both.items() if pair[0] is not None and pair[1]}


def goals(run: dict, before: dict) -> list[str]:
    """The goals that say how much less than before."""
    lines = []
    for text, key in (("triangles drawn", "triangles"), ("bytes fetched", "bytes")):
        mean = geometric_mean(changes(run, before, key).values())
        lines.append(at_most(f"{text} / before, geometric mean", 0.5, mean))
    both = changes(run, before, "build_secs")
    secs = [sum(rows(it)[name]["build_secs"] for name in both) for it in (run, before)]
    return [*lines, at_most("build seconds / before, all models", 1, secs[0] / secs[1] if both else None)]


def side_by_side(run: dict, before: dict) -> list[str]:
    """After over before, a row a model; dB gained; cuts' triangles at each error."""
    names = "".join(f" {name:>8s}" for name, _ in SIDE)
    lines = [f"{'after / before':22s}{names} {'dB':>6s}  triangles at {', '.join(f'{it:.0e}' for it in SHARES)}"]
    of = {key: changes(run, before, key) for _, key in SIDE}
    for name, after in rows(run).items():
        earlier = rows(before).get(name)
        if not earlier:
            continue
        decibels = [it.get("psnr_db") for it in (after, earlier)]
        line = "".join(f" {of[key][name]:8.3f}" if name in of[key] else f"{'-':>9s}" for _, key in SIDE)
        line += f" {decibels[0] - decibels[1]:+6.1f} " if all(decibels) else f"{'-':>7s} "
        cuts = zip(after.get("cut_triangles", ()), earlier.get("cut_triangles", ()))
        lines.append(f"{name:22s}{line}" + "".join(f" {a / b:6.3f}" for a, b in cuts))
    means = [geometric_mean(of[key].values()) for _, key in SIDE]
    lines.append(f"{'geometric mean':22s}" + "".join(f" {it:8.3f}" if it else f"{'-':>9s}" for it in means))
    return lines + views(run, before)


def views(run: dict, before: dict) -> list[str]:
    """Foliage at each size and rocks, after over before."""
    lines = []
    for kind in ("foliage", "rocks"):
        for name in run[kind].keys() & before[kind].keys():
            pair = [it[kind][name] if kind == "foliage" else [it[kind][name]["view"]] for it in (run, before)]
            for after, earlier in zip(*pair):
                ratios = " ".join(f"{it} {after[it] / max(earlier[it], 1):.3f}" for it in ("triangles", "bytes", "pages"))
                lines.append(f"{name:22s} {after['size'][0]:4d}x{after['size'][1]:<4d} {ratios}")
    return sorted(lines)


def slim(figures: dict) -> dict:
    """What another run stands beside and the report draws, without what depends on the machine."""
    cuts = ("model", "share", "triangles", "judged", "largest", "plain_judged")
    return {
        "rows": [{key: it for key, it in row.items() if key != "build_secs"} for row in figures["rows"]],
        "cuts": [{key: it[key] for key in cuts} for it in figures["cuts"]],
        "curves": figures["curves"],
        "foliage": figures["foliage"],
        "rocks": {name: {"view": it["view"]} for name, it in figures["rocks"].items()},
    }


def rounded(value):
    """Five digits are more than is compared."""
    match value:
        case dict():
            return {key: rounded(it) for key, it in value.items()}
        case list():
            return [rounded(it) for it in value]
        case float():
            return float(f"{value:.5g}")
    return value


def written(figures: dict) -> str:
    """JSON of a row a line."""
    parts = []
    for key, value in figures.items():
        items = [json.dumps(it) for it in value] if isinstance(value, list) else [f"{json.dumps(name)}: {json.dumps(it)}" for name, it in value.items()]
        marks = "[]" if isinstance(value, list) else "{}"
        parts.append(f"{json.dumps(key)}: {marks[0]}\n" + ",\n".join(items) + f"\n{marks[1]}")
    return "{" + ",\n".join(parts) + "}\n"
