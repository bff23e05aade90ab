"""The type of an array that is prepared on the host and used in kernels."""

from typing import TYPE_CHECKING, Any

import jax
import numpy as np

if TYPE_CHECKING:
    # a static checker cannot follow one field from NumPy on the host to JAX in the kernel
    AnyArray = Any
else:
    AnyArray = np.ndarray | jax.Array
