"""What every solver's kernel returns."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int


class Estimate(eqx.Module):
    """X of AX = XB as rotation and translation; ``scale`` times the given t_A is in the unit of t_B."""

    R: Float[jax.Array, "3 3"]
    t: Float[jax.Array, "3"]
    scale: Float[jax.Array, ""]
    steps: Int[jax.Array, ""] = eqx.field(default_factory=lambda: jnp.zeros((), jnp.int32))
    converged: Bool[jax.Array, ""] = eqx.field(default_factory=lambda: jnp.ones((), bool))
