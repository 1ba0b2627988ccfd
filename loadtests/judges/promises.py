"""What groups store over what `lodestream-loadtests measure` finds."""

from programs import Programs

# Assets of a scene that are measured, the largest first.
ASSETS = 3
# Samples of the cuts of whole levels: their table is not judged here, only shown.
LEVEL_SAMPLES = 20_000


def promises(programs: Programs, scene: str) -> dict:
    """Percentiles of stored over measured, groups that exceed, and the levels of the largest asset.

    Of several assets the percentiles are means over groups."""
    said = programs.reported(programs.loadtests, "measure", programs.library, "--scene", scene, "--largest", ASSETS, "--samples", LEVEL_SAMPLES)
    rows = [it for it in said["promises"] if it["measured"]]
    measured = sum(it["measured"] for it in rows)

    def mean(key: str) -> float | None:
        known = [it for it in rows if it[key] is not None]
        return sum(it[key] * it["measured"] for it in known) / sum(it["measured"] for it in known) if known else None

    largest = max(said["rows"], key=lambda it: it["source_triangles"])
    return {
        "groups": sum(it["groups"] for it in said["promises"]),
        "measured": measured,
        "unbounded": sum(it["unbounded"] for it in rows),
        "worst_excess": max((it["worst_excess"] for it in rows), default=0.0),
        "p50": mean("ratio_p50"),
        "p95": mean("ratio_p95"),
        "level_cuts": largest["level_cuts"],
        "opened_edges": max(it["opened_edges"] for it in said["rows"]),
    }
