"""Laws of the map being filled in: which label wins, orientations, angles, far sides."""

import numpy as np

from jaxmodel.control_points.edge_map import EdgeKind, EdgeMarks

ROW, COLUMN = 1, 0
HERE = np.array([2]), np.array([3])


def marks() -> EdgeMarks:
    return EdgeMarks((5, 6))


def test_the_higher_label_wins_in_any_order() -> None:
    labels = (EdgeKind.CREASE, EdgeKind.BORDER, EdgeKind.DEPTH)
    for order in ((0, 1, 2), (2, 1, 0), (1, 0, 2), (0, 2, 1)):
        map_ = marks()
        for i in order:
            map_.mark(labels[i], ROW, *HERE)
        assert map_.kind[2, 3] == EdgeKind.DEPTH
        assert np.count_nonzero(map_.kind) == 1
    map_ = marks()
    assert map_.mark(EdgeKind.BORDER, ROW, *HERE).all()
    assert not map_.mark(EdgeKind.CREASE, ROW, *HERE).any()
    assert map_.kind[2, 3] == EdgeKind.BORDER


def test_orientations_add_within_a_label_and_start_anew_with_a_higher_one() -> None:
    map_ = marks()
    map_.mark(EdgeKind.CREASE, ROW, *HERE)
    assert map_.orientation[2, 3] == 1
    map_.mark(EdgeKind.CREASE, COLUMN, HERE[1], HERE[0])  # the same pixel, lines and places swapped
    assert map_.orientation[2, 3] == 3
    map_.mark(EdgeKind.DEPTH, COLUMN, HERE[1], HERE[0])
    assert map_.orientation[2, 3] == 2


def test_the_larger_angle_stays() -> None:
    map_ = marks()
    line, place = np.array([2, 2]), np.array([3, 3])
    map_.mark_creases(ROW, line, place, np.array([-50.0, 30.0]))
    map_.mark_creases(COLUMN, HERE[1], HERE[0], np.array([40.0]))
    assert map_.finished(np.ones((5, 6), dtype=bool), 0.0).angle_deg[2, 3] == -50.0


def test_the_finished_map_has_angles_on_creases_and_far_sides_on_jumps_only() -> None:
    map_ = marks()
    map_.mark_creases(ROW, *HERE, np.array([45.0]))
    map_.mark_jumps(ROW, HERE[0], HERE[1], HERE[1] + 1)
    valid = np.ones((5, 6), dtype=bool)
    found = map_.finished(valid, 0.25)
    assert found.kind[2, 3] == found.kind[2, 4] == EdgeKind.DEPTH
    assert np.argwhere(found.far).tolist() == [[2, 4]]
    assert np.isnan(found.angle_deg).all()
    assert found.noise == 0.25 and found.valid is valid
