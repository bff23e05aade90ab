"""Registration with no first guess: proposals from local geometry and an even grid, the best of them step by step.

Thousands of poses are proposed (``proposals.py``) or started from an even grid of rotations, each is examined both ways
with what the sensors saw (``evidence.py``), and fewer and fewer go on to finer registration: coarse ICP, point-to-plane
ICP, the exact fit (``refine_pair.py``), a last look around the best. What is left is judged (``verdict.py``).
"""

from collections.abc import Mapping

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.register.candidates import Candidates, PairOfViews
from jaxmodel.register.degeneracy import Freedom, freedom
from jaxmodel.register.evidence import ALIKE
from jaxmodel.register.method import IcpMethod, Strategy, ZhangFilter
from jaxmodel.register.proposals import Pairs, alike, propose
from jaxmodel.register.refine_pair import refine
from jaxmodel.register.starts import even_rotations
from jaxmodel.register.verdict import Found, judged, same_scan
from jaxmodel.register.view_of_scan import ViewOfScan, size_of, view_of
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage

Scan = RangeImage | Cloud | np.ndarray
FEW_SHARED = 50
"""Points of 3000 that must be shared to tell what they are free to do."""
MOST_RATIO = 50.0
"""Of the sizes of two scans of one object: beyond, they are taken for different units."""

FROM_GRID = IcpMethod(
    strategies=(Strategy(),),
    zhang=ZhangFilter(initial=40.0),
    max_iterations=25,
    cells=64,
    stop="motion",
    rotation_tolerance_deg=0.5,
    translation_tolerance=2e-3,
)
"""From far away: points to points, with Zhang's filter to let go of what the other scan does not show."""
TO_PLANES = IcpMethod(
    strategies=(Strategy(),),
    objective="point_to_plane",
    max_distance=0.05,
    max_iterations=15,
    cells=64,
    stop="motion",
    rotation_tolerance_deg=0.05,
    translation_tolerance=2e-4,
)
"""From nearby."""


class SearchOptions(eqx.Module):
    """How hard a search tries; distances in its length (the smaller scan's size).

    ``pairs`` of points that look alike are seeds of proposals, ``tolerance`` what the distances of two that agree may
    differ by; ``grid`` rotations are started from; ``coarse``, ``fine`` and ``last`` candidates go on to point-to-plane
    ICP, to the exact fit, and to a look around them with ``around`` starts each; surfaces are the same within
    ``reach``, at last within ``last_reach``.
    """

    pairs: int = 2048
    tolerance: float = 0.01
    grid: int = 480
    coarse: int = 64
    fine: int = 10
    last: int = 3
    around: int = 64
    reach: float = 0.015
    last_reach: float = 0.008

    def __check_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be greater than 0, not {getattr(self, name)}")


def search(target: Scan, source: Scan, options: SearchOptions | None = None) -> Found:
    """Register two scans from no first guess, and say how far to trust the result.

    Args:
        target: range image, cloud or points ``(n, 3)`` that stays. A range image also tells of free space.
        source: the scan that is moved onto it.
        options: how hard to try.

    Raises:
        InputError: a scan that cannot be registered, or two of different units.
    """
    views, length = views_of({"the target": target, "the source": source})
    return search_pair(PairOfViews(views["the target"], views["the source"], length), options)


def search_pair(pair: PairOfViews, options: SearchOptions | None = None) -> Found:
    """As :func:`search`, of two views made ready with others (:func:`views_of`)."""
    mine, theirs = pair.target.whole.points, pair.source.whole.points
    if mine.shape == theirs.shape and np.abs(mine - theirs).max() <= 1e-9 * pair.length:
        return same_scan()
    options = SearchOptions() if options is None else options
    found = judged(candidates(pair, options))
    return found._replace(freedom=shared_freedom(pair, found.T_target_source, options.last_reach))


def shared_freedom(pair: PairOfViews, T_target_source: Float[np.ndarray, "4 4"], reach: float) -> Freedom | None:
    """What the part that both scans show is free to do, target frame; None where it is too small to tell.

    ``reach``: how far apart surfaces may be that are the same, in the length of the search.
    """
    target, source = pair.target.surface, pair.source.surface
    R, t = T_target_source[:3, :3], T_target_source[:3, 3]
    points, normals = source.points[source.asked] @ R.T + t, source.normals[source.asked] @ R.T
    away, near = target.tree.query(points, distance_upper_bound=reach * pair.length)
    held = np.flatnonzero(np.isfinite(away))
    held = held[np.einsum("na,na->n", normals[held], target.normals[near[held]]) > ALIKE]
    return freedom(points[held], normals[held]) if len(held) >= FEW_SHARED else None


def views_of(scans: Mapping[str, Scan]) -> tuple[dict[str, ViewOfScan], float]:
    """Scans by name, made ready to be searched in pairs, and the length that all measure in.

    Raises:
        InputError: a scan that cannot be registered, or sizes so far apart that the units must differ.
    """
    sizes = {name: size_of(scan, name) for name, scan in scans.items()}
    small, large = min(sizes, key=lambda name: sizes[name]), max(sizes, key=lambda name: sizes[name])
    ratio = sizes[large] / sizes[small]
    if ratio > MOST_RATIO:
        metres = 300 < ratio < 3000
        units = ", like metres and millimetres (a factor of 1000): scale one of them" if metres else ""
        raise InputError(
            f"{small} is {sizes[small]:.4g} across and {large} {sizes[large]:.4g}: expected scans of one unit, these "
            f"seem to be in different ones{units}"
        )
    length = float(np.median(list(sizes.values()))) if len(sizes) > 2 else sizes[small]
    return {name: view_of(scan, length, name) for name, scan in scans.items()}, length


def candidates(pair: PairOfViews, options: SearchOptions) -> Candidates:
    """The poses that are left at last, best first, each a different one; at least one."""
    far = pair.best(pair.examined(_proposed(pair, options), options.reach), options.coarse, 10.0, 0.04)
    started = pair.registered(_grid(pair, options), FROM_GRID)
    far = far.joined(pair.best(pair.examined(started, options.reach), options.coarse // 2, 10.0, 0.04))
    near = pair.registered(far.T_target_source, TO_PLANES)
    fitted = _fitted(pair, pair.best(pair.examined(near, options.reach), options.fine, 5.0, 0.02), options)
    around = pair.registered(_around(pair, fitted.T_target_source[: options.last], options), TO_PLANES)
    again = _fitted(pair, pair.best(pair.examined(around, options.reach), 2 * options.last, 2.0, 0.01), options)
    return pair.best(fitted.joined(again), options.fine, 3.0, 0.015)


def _proposed(pair: PairOfViews, options: SearchOptions) -> Float[np.ndarray, "n 4 4"]:
    """From points whose surroundings look alike."""
    target, source = pair.target, pair.source
    rows, columns = alike(target.features, source.features, options.pairs)
    here, there = target.thin.take(target.described[rows]), source.thin.take(source.described[columns])
    assert here.normals is not None and there.normals is not None
    seeds = Pairs(there.points, there.normals, here.points, here.normals)
    return propose(seeds, options.tolerance * pair.length)


def _grid(pair: PairOfViews, options: SearchOptions) -> Float[np.ndarray, "n 4 4"]:
    """Every way to turn the source, its centre on the target's."""
    T = np.tile(np.eye(4), (options.grid, 1, 1))
    T[:, :3, :3] = even_rotations(options.grid)
    T[:, :3, 3] = pair.target.centre - T[:, :3, :3] @ pair.source.centre
    return T


def _fitted(pair: PairOfViews, found: Candidates, options: SearchOptions) -> Candidates:
    """Fitted exactly, examined with the last reach, best first."""
    surfaces = pair.target.surface, pair.source.surface
    T = np.stack([refine(*surfaces, each, pair.length).T_target_source for each in found.T_target_source])
    return pair.best(pair.examined(T, options.last_reach), len(T), 3.0, 0.015)


def _around(pair: PairOfViews, T: Float[np.ndarray, "n 4 4"], options: SearchOptions) -> Float[np.ndarray, "m 4 4"]:
    """Starts around each pose: turned by up to 15 degrees about the source's centre, moved by up to 4 % of a length."""
    draw = np.random.default_rng(0)
    turn = draw.uniform(-1, 1, (options.around, 3)) * np.deg2rad(15) / np.sqrt(3) * 1.5
    shift = draw.uniform(-1, 1, (options.around, 3)) * 0.04 * pair.length
    out = np.tile(np.eye(4), (len(T), options.around, 1, 1))
    R = Rotation.from_rotvec(turn).as_matrix()
    out[:, :, :3, :3] = R[None] @ T[:, None, :3, :3]
    placed = T[:, :3, :3] @ pair.source.centre + T[:, :3, 3]
    out[:, :, :3, 3] = placed[:, None] + shift[None] - out[:, :, :3, :3] @ pair.source.centre
    return out.reshape(-1, 4, 4)
