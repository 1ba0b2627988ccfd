"""The judge itself: distances by the tree against all triangles, a cut off by a known amount."""

import numpy as np

from distance import Tree, to_triangles
from floor import Source
from surface import Surface


def sheet(side: int, height: float = 0.0) -> Surface:
    """A square of side 1 of so many quads a side."""
    x, y = (it.reshape(-1) for it in np.meshgrid(np.linspace(0, 1, side + 1), np.linspace(0, 1, side + 1)))
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    below = first + side + 1
    faces = np.concatenate([np.stack([first, first + 1, below], 1), np.stack([below, first + 1, below + 1], 1)])
    return Surface(np.stack([x, y, np.full(len(x), height)], 1), faces)


def tree_and_all_triangles_agree() -> None:
    random = np.random.default_rng(7)
    # Small, long, flat and large triangles, some without area.
    middles = random.random((600, 1, 3))
    shapes = random.normal(size=(600, 3, 3)) * 10.0 ** random.uniform(-4, 0, (600, 1, 1))
    shapes[::7, 2] = shapes[::7, 1]
    shapes[::5] *= (1, 1e-5, 1e-5)
    surface = Surface((middles + shapes).reshape(-1, 3), np.arange(1800).reshape(-1, 3))
    points = np.concatenate([random.random((300, 3)), surface.some_vertices(100, random) + 1e-3, random.normal(size=(50, 3)) * 20])
    found = Tree(surface).distances(points)
    a, b, c = np.moveaxis(surface.corners(), 1, 0)
    for point, distance in zip(points, found):
        least = np.sqrt(to_triangles(np.broadcast_to(point, a.shape), a, b, c).min())
        if abs(least - distance) > 1e-6 * max(1.0, least):
            raise AssertionError(f"distance of {point}: expected {least}, found {distance}")


def triangles_have_their_known_distances() -> None:
    a, b, c = (np.array([it], float) for it in ((0, 0, 0), (4, 0, 0), (0, 3, 0)))
    known = [((1, 1, 2), 2), ((-3, -4, 0), 5), ((2, -1, 0), 1), ((-2, 1, 0), 2), ((6, 0, 0), 2), ((0, 5, 1.5), 2.5), ((4, 3, 0), 2.4)]
    for point, expected in known:
        found = np.sqrt(to_triangles(np.array([point], float), a, b, c)[0])
        if abs(found - expected) > 1e-12:
            raise AssertionError(f"distance of {point}: expected {expected}, found {found}")


def a_moved_cut_is_off_by_its_move() -> None:
    found = Source(sheet(40)).against(sheet(3, 0.25))
    for name in ("to_cut", "to_source", "judged", "p99"):
        if abs(getattr(found, name) - 0.25) > 1e-9:
            raise AssertionError(f"sheet moved by 0.25: found {name} {getattr(found, name)}")
    # A spike, and a lost corner, each seen from one side alone.
    spike = sheet(3)
    spike.places[5, 2] = 0.5
    found = Source(sheet(40)).against(spike)
    if not (found.to_source == 0.5 and found.to_cut < 0.5):
        raise AssertionError(f"spike of 0.5: found {found}")
    lost = sheet(40)
    lost.faces = lost.faces[~(lost.places[lost.faces] < 0.2).all((1, 2))]
    found = Source(sheet(40)).against(lost)
    if not (found.to_source < 1e-9 and found.to_cut > 0.15):
        raise AssertionError(f"corner of 0.2 lost: found {found}")


def welding_joins_equal_places() -> None:
    soup = sheet(4)
    corners = soup.places[soup.faces].reshape(-1, 3)
    welded = Surface(corners, np.arange(len(corners)).reshape(-1, 3)).welded()
    if (len(welded.places), len(welded.faces)) != (25, 32):
        raise AssertionError(f"sheet of 25 places and 32 triangles: found {len(welded.places)} and {len(welded.faces)}")


def all_hold() -> None:
    triangles_have_their_known_distances()
    tree_and_all_triangles_agree()
    a_moved_cut_is_off_by_its_move()
    welding_joins_equal_places()
