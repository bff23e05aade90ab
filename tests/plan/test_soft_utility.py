import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.plan.label_map import unknown_map
from jaxmodel.plan.soft_utility import ClimbOutcome, levenberg_marquardt
from jaxmodel.scan.sensor import Sensor

SENSOR = Sensor(16, 16, field_of_view_deg=40.0)


def _map():
    """A ball of unknown in the middle of an empty cube."""
    map = unknown_map(VoxelGrid(np.zeros(3), 1.0, (32, 32, 32)), open_outside=True)
    centres = map.grid.centres(np.arange(32**3)).reshape(32, 32, 32, 3)
    return eqx.tree_at(lambda m: m.crossed, map, np.linalg.norm(centres - 16, axis=-1) > 6)


def _pose(parameter):
    """A sensor 40 cells before the ball that slides across."""
    return jnp.eye(4).at[:3, 3].set(jnp.stack([parameter[0], parameter[1], jnp.asarray(-24.0)]))


def _meets_less(shares, quality):
    return jnp.stack([1 - shares[0], 0.1 * jnp.sum(quality)])


def test_no_view_is_worse_than_its_start_and_each_is_that_of_its_start_alone():
    starts = np.asarray([[8.0, 16.0], [16.0, 3.0], [16.0, 16.0], [500.0, 0.0]])
    found = levenberg_marquardt(_map(), SENSOR, _pose, _meets_less, starts)
    assert (found.cost <= found.start_cost).all()
    assert (found.cost[:2] < found.start_cost[:2]).all()
    assert found.steps.max() <= 12
    np.testing.assert_array_equal(found.parameter[3], np.float32(starts[3]))
    alone = levenberg_marquardt(_map(), SENSOR, _pose, _meets_less, starts[1:2])
    np.testing.assert_array_equal(alone.parameter[0], found.parameter[1])


def test_residuals_that_are_no_numbers_return_the_start():
    found = levenberg_marquardt(_map(), SENSOR, _pose, lambda shares, quality: shares * jnp.nan, np.ones((1, 2)))
    assert found.outcome[0] == ClimbOutcome.NOT_FINITE
    np.testing.assert_array_equal(found.parameter, np.ones((1, 2), np.float32))


@pytest.mark.parametrize("starts", [np.full((1, 2), np.nan), np.zeros((2, 0))])
def test_starts_that_are_none_are_refused(starts):
    with pytest.raises(InputError, match="starts of a climb"):
        levenberg_marquardt(_map(), SENSOR, _pose, _meets_less, starts)


def test_every_outcome_has_its_sentence():
    assert len({outcome.sentence for outcome in ClimbOutcome}) == len(ClimbOutcome)
