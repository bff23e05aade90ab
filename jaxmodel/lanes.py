"""The lane engine: one step function, thousands of items, two executors with the same results.

A ``Kernel`` says how an item begins, steps and ends. The ``cores`` executor (CPU) gives each device its own items and
runs them one after the other, each in a ``while_loop`` that ends when that item is done: the whole working set stays in
cache. The ``lanes`` executor (GPU) steps ``lanes`` items together and refills each finished lane with the next item,
so that no item waits for the slowest. Both take items in chunks of a fixed capacity, so a sweep compiles once,
memory does not grow with the number of items, and progress and resume have their unit.
"""

from abc import abstractmethod
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Bool, Int, PyTree

State = PyTree
Item = PyTree
Result = PyTree

# Work is spread over devices, one per core, so a kernel must not spread itself over threads too.
CPU_OPTIONS: dict[str, bool | str] = {"xla_cpu_multi_thread_eigen": False}

# Letting the compiler reorder sums of floats makes them vector code; infinities and NaN keep their meaning.
REORDERING: dict[str, bool | str] = {
    "xla_cpu_enable_fast_math": True,
    "xla_cpu_fast_math_honor_infs": True,
    "xla_cpu_fast_math_honor_nans": True,
    "xla_cpu_fast_math_honor_division": True,
}


class Kernel(eqx.Module):
    """One problem shared by many items. All members are pure and written for a single item."""

    @property
    def reorders_sums(self) -> bool:
        """Whether sums of floats may be reordered: faster, but then executors round differently. By default they may.

        A kernel whose steps decide by comparisons (which point is closest) can turn one bit into another basin.
        """
        return True

    @abstractmethod
    def init(self, item: Item) -> State:
        """The state an item starts from."""

    @abstractmethod
    def step(self, state: State) -> State:
        """One iteration."""

    @abstractmethod
    def done(self, state: State) -> Bool[jax.Array, ""]:
        """Whether the item needs no further step."""

    @abstractmethod
    def finish(self, state: State) -> Result:
        """What is kept of a finished item."""


class Engine(eqx.Module):
    """How items are executed. Results do not depend on ``chunk``; across executors they agree to float32 rounding."""

    executor: Literal["auto", "cores", "lanes"] = eqx.field(static=True, default="auto")
    lanes: int = eqx.field(static=True, default=256)
    chunk: int = eqx.field(static=True, default=256)
    steps_per_round: int = eqx.field(static=True, default=4)

    def __check_init__(self) -> None:
        for name in ("lanes", "chunk", "steps_per_round"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, not {getattr(self, name)}")

    def resolved(self) -> Literal["cores", "lanes"]:
        """The executor that "auto" stands for on this machine."""
        if self.executor != "auto":
            return self.executor
        return "cores" if jax.default_backend() == "cpu" else "lanes"


def run_chunk(kernel: Kernel, items: Item, engine: Engine) -> Result:
    """Results (NumPy, item order) of at most ``engine.chunk`` items, given as NumPy arrays with a leading item axis."""
    count = jax.tree.leaves(items)[0].shape[0]
    if count > engine.chunk:
        raise ValueError(f"{count} items do not fit a chunk of {engine.chunk}")
    if engine.resolved() == "cores":
        devices = len(jax.devices())
        capacity = -(-engine.chunk // devices) * devices
        # item i goes to device i mod devices, so that neighbouring (similar) items are spread evenly
        dealt = jax.tree.map(lambda a: _deal(_padded(a, capacity), devices), items)
        counts = np.asarray([len(range(d, count, devices)) for d in range(devices)], np.int32)
        results = _cores(devices, kernel.reorders_sums)(kernel, dealt, counts)
        return jax.tree.map(lambda a: _collect(np.asarray(a))[:count], results)
    padded = jax.tree.map(lambda a: _padded(a, engine.chunk), items)
    results = _lanes(kernel.reorders_sums)(kernel, padded, np.int32(count), engine.lanes, engine.steps_per_round)
    return jax.tree.map(lambda a: np.asarray(a)[:count], results)


def run_chunks(
    kernel: Kernel,
    items: Item,
    engine: Engine,
    order: Int[np.ndarray, " n"] | None = None,
    skip: frozenset[int] = frozenset(),
) -> Iterator[tuple[int, Int[np.ndarray, " c"], Result]]:
    """Chunk by chunk: its number, the items in it, their results. ``skip`` names the chunks already done."""
    total = jax.tree.leaves(items)[0].shape[0]
    order = np.arange(total) if order is None else order
    kernel = _on_devices(kernel, engine)
    for number, first in enumerate(range(0, total, engine.chunk)):
        if number in skip:
            continue
        members = order[first : first + engine.chunk]
        yield number, members, run_chunk(kernel, jax.tree.map(lambda a, m=members: a[m], items), engine)


def run(kernel: Kernel, items: Item, engine: Engine) -> Result:
    """Results of all items, in item order (NumPy arrays with a leading item axis)."""
    total = jax.tree.leaves(items)[0].shape[0]
    if total == 0:
        raise ValueError("a run needs at least one item")
    parts = [part for _, _, part in run_chunks(kernel, items, engine)]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _on_devices(kernel: Kernel, engine: Engine) -> Kernel:
    """The kernel's arrays placed once, not with every chunk."""
    if engine.resolved() == "cores":
        return jax.device_put(kernel, NamedSharding(_mesh(len(jax.devices())), PartitionSpec()))
    return jax.device_put(kernel)


@lru_cache
def _mesh(devices: int) -> Mesh:
    return Mesh(np.asarray(jax.devices()[:devices]), ("core",))


def _padded(array: np.ndarray, length: int) -> np.ndarray:
    return np.concatenate([array, np.repeat(array[:1], length - len(array), axis=0)]) if len(array) < length else array


def _deal(array: np.ndarray, devices: int) -> np.ndarray:
    """Rows dealt out like cards: block d of the result holds rows d, d + devices, ..."""
    return np.concatenate([array[d::devices] for d in range(devices)])


def _collect(array: np.ndarray) -> np.ndarray:
    """Inverse of ``_deal`` once each device has answered with its own block, stacked on the leading axis."""
    return np.swapaxes(array, 0, 1).reshape(-1, *array.shape[2:])


def _one_item(kernel: Kernel, item: Item) -> Result:
    # lambdas: a bound method of a module of tracers cannot be hashed
    state = jax.lax.while_loop(lambda s: ~kernel.done(s), lambda s: kernel.step(s), kernel.init(item))
    return kernel.finish(state)


@lru_cache
def _cores(devices: int, reorder: bool) -> Any:
    split, whole = PartitionSpec("core"), PartitionSpec()

    def one_core(kernel: Kernel, items: Item, count: jax.Array) -> Result:
        first = jax.tree.map(lambda a: a[0], items)
        shape = jax.eval_shape(_one_item, kernel, first)
        capacity = jax.tree.leaves(items)[0].shape[0]
        buffers = jax.tree.map(lambda s: jnp.zeros((capacity, *s.shape), s.dtype), shape)

        def body(i: jax.Array, results: Result) -> Result:
            result = _one_item(kernel, jax.tree.map(lambda a: a[i], items))
            return jax.tree.map(lambda all_, one: all_.at[i].set(one), results, result)

        # a traced bound: short chunks reuse the compiled program and do no padded work
        results = jax.lax.fori_loop(0, count[0], body, buffers)
        return jax.tree.map(lambda a: a[None], results)

    sharded = jax.shard_map(
        one_core, mesh=_mesh(devices), in_specs=(whole, split, split), out_specs=split, check_vma=False
    )
    return jit_kernel(sharded, reorder)


@lru_cache
def _lanes(reorder: bool) -> Any:
    return jit_kernel(_run_lanes, reorder, static_argnums=(3, 4))


def jit_kernel(function: Any, reorder: bool, **options: Any) -> Any:
    """``jax.jit`` with the options all kernels are compiled with; ``reorder``: see ``Kernel.reorders_sums``."""
    on_cpu = jax.default_backend() == "cpu"
    compiler = CPU_OPTIONS | (REORDERING if reorder else {})
    return jax.jit(function, compiler_options=compiler if on_cpu else None, **options)


def _where(mask: jax.Array, new: PyTree, old: PyTree) -> PyTree:
    return jax.tree.map(lambda n, o: jnp.where(mask.reshape(mask.shape + (1,) * (n.ndim - 1)), n, o), new, old)


def _run_lanes(kernel: Kernel, items: Item, count: jax.Array, lanes: int, steps_per_round: int) -> Result:
    capacity = jax.tree.leaves(items)[0].shape[0]
    lanes = min(lanes, capacity)
    shape = jax.eval_shape(_one_item, kernel, jax.tree.map(lambda a: a[0], items))
    # one spare row takes what the idle lanes write
    results = jax.tree.map(lambda s: jnp.zeros((capacity + 1, *s.shape), s.dtype), shape)
    item = jnp.arange(lanes, dtype=jnp.int32)
    take = lambda index: jax.tree.map(lambda a: a[jnp.minimum(index, capacity - 1)], items)  # noqa: E731
    init, step = jax.vmap(lambda i: kernel.init(i)), jax.vmap(lambda s: kernel.step(s))
    done, finish = jax.vmap(lambda s: kernel.done(s)), jax.vmap(lambda s: kernel.finish(s))

    def inner(_: jax.Array, state: State) -> State:
        return _where(done(state), state, step(state))

    def one_round(carry: tuple) -> tuple:
        state, item, following, results = carry
        state = jax.lax.fori_loop(0, steps_per_round, inner, state)
        ended = done(state) & (item < count)

        def refill(args: tuple) -> tuple:
            state, item, following, results = args
            row = jnp.where(ended, item, capacity)
            finished = finish(state)
            results = jax.tree.map(lambda all_, new: all_.at[row].set(new), results, finished)
            position = jnp.cumsum(ended.astype(jnp.int32)) - 1
            item = jnp.where(ended, jnp.minimum(following + position, count), item)
            state = _where(ended & (item < count), init(take(item)), state)
            return state, item, following + jnp.sum(ended.astype(jnp.int32)), results

        return jax.lax.cond(jnp.any(ended), refill, lambda args: args, (state, item, following, results))

    start = (init(take(item)), jnp.minimum(item, count), jnp.int32(lanes), results)
    _, _, _, results = jax.lax.while_loop(lambda carry: jnp.any(carry[1] < count), one_round, start)
    return jax.tree.map(lambda a: a[:capacity], results)


def vmap_baseline(kernel: Kernel, items: Item) -> Result:
    """The plain alternative for benchmarks and tests: ``vmap`` of a ``while_loop``, where all wait for the slowest."""
    return jit_kernel(partial(jax.vmap, in_axes=(None, 0))(_one_item), kernel.reorders_sums)(kernel, items)
