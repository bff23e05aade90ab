"""The lane engine: both executors and the plain vmap give the same results, whatever the chunks, lanes and order."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Bool, Int

from jaxmodel import lanes
from jaxmodel.lanes import Engine, Kernel, run, run_chunk, run_chunks, vmap_baseline

ENGINES = {
    "cores": Engine("cores", chunk=64),
    "cores, odd chunk": Engine("cores", chunk=7),
    "cores, chunk of one": Engine("cores", chunk=1),
    "cores, chunk beyond the items": Engine("cores", chunk=1000),
    "lanes": Engine("lanes", lanes=16, chunk=64),
    "lanes, one step a round": Engine("lanes", lanes=5, chunk=23, steps_per_round=1),
    "lanes, one lane": Engine("lanes", lanes=1, chunk=40),
    "lanes, chunk of one": Engine("lanes", lanes=8, chunk=1),
    "lanes, more than items": Engine("lanes", lanes=512, chunk=1000),
}


class Collatz(Kernel):
    """Counts the steps of n -> n/2 or 3n + 1 down to 1: whole numbers, so results must be equal to the last bit."""

    odd_factor: Int[jax.Array | np.ndarray, ""]

    def init(self, item: dict) -> dict:
        return {"start": item["n"], "n": item["n"], "steps": jnp.zeros((), jnp.int32), "highest": item["n"]}

    def step(self, state: dict) -> dict:
        n = jnp.where(state["n"] % 2 == 0, state["n"] // 2, self.odd_factor * state["n"] + 1)
        return {**state, "n": n, "steps": state["steps"] + 1, "highest": jnp.maximum(state["highest"], n)}

    def done(self, state: dict) -> Bool[jax.Array, ""]:
        return state["n"] <= 1

    def finish(self, state: dict) -> dict:
        pair = jnp.stack([state["start"], state["highest"]])
        return {"steps": state["steps"], "pair": pair, "end": state["n"]}


KERNEL = Collatz(np.asarray(3, np.int32))


def collatz(n: int) -> tuple[int, int]:
    steps, highest = 0, n
    while n > 1:
        n = n // 2 if n % 2 == 0 else 3 * n + 1
        steps, highest = steps + 1, max(highest, n)
    return steps, highest


def items(numbers: np.ndarray) -> dict:
    return {"n": np.asarray(numbers, np.int32)}


def check(numbers: np.ndarray, results: dict) -> None:
    expected = np.array([collatz(int(n)) for n in numbers])
    np.testing.assert_array_equal(results["steps"], expected[:, 0])
    np.testing.assert_array_equal(results["pair"], np.stack([numbers, expected[:, 1]], axis=1))
    assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(results))


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("numbers", [np.arange(1, 98), np.array([27]), np.array([1, 1, 97, 1, 1])], ids=len)
def test_every_engine_counts_right(name: str, numbers: np.ndarray) -> None:
    """Ragged counts, and items that are done before their first step (n = 1)."""
    check(numbers, run(KERNEL, items(numbers), ENGINES[name]))


def test_all_items_done_at_once() -> None:
    for engine in (Engine("cores", chunk=64), Engine("lanes", lanes=16, chunk=64)):
        result = run(KERNEL, items(np.ones(40)), engine)
        np.testing.assert_array_equal(result["steps"], 0)
        np.testing.assert_array_equal(result["end"], 1)


def test_the_plain_vmap_agrees() -> None:
    numbers = np.arange(1, 98)
    check(numbers, jax.tree.map(np.asarray, vmap_baseline(KERNEL, items(numbers))))


class Newton(Kernel):
    """Square roots by Newton's rule in float32: rounding shows any difference in the arithmetic."""

    tolerance: jax.Array | np.ndarray

    def init(self, item: jax.Array) -> tuple[jax.Array, jax.Array]:
        return item, item

    def step(self, state: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        x, a = state
        return 0.5 * (x + a / x), a

    def done(self, state: tuple[jax.Array, jax.Array]) -> jax.Array:
        x, a = state
        return jnp.abs(x * x - a) <= self.tolerance * a

    def finish(self, state: tuple[jax.Array, jax.Array]) -> jax.Array:
        return state[0]


@pytest.mark.parametrize("name", ["cores", "lanes"])
def test_chunks_and_order_do_not_change_a_bit(name: str) -> None:
    kernel = Newton(np.asarray(1e-5, np.float32))
    values = np.random.default_rng(0).lognormal(0, 3, size=90).astype(np.float32)
    whole = run(kernel, values, Engine(name, lanes=16, chunk=128))  # type: ignore[arg-type]
    np.testing.assert_allclose(whole, np.sqrt(values), rtol=1e-4)
    for chunk in (1, 32, 89):
        np.testing.assert_array_equal(run(kernel, values, Engine(name, lanes=16, chunk=chunk)), whole)  # type: ignore
    order = np.random.default_rng(1).permutation(90)
    engine = Engine(name, lanes=16, chunk=32)  # type: ignore[arg-type]
    seen = np.full(90, np.nan, np.float32)
    for _, members, part in run_chunks(kernel, values, engine, order):
        seen[members] = part
    np.testing.assert_array_equal(seen, whole)
    for start in (0, 41, 89):
        np.testing.assert_array_equal(run(kernel, values[start : start + 1], engine), whole[start : start + 1])


def test_chunks_cover_the_items_and_skip_what_is_done() -> None:
    numbers = np.arange(1, 24)
    engine = Engine("cores", chunk=5)
    chunks = list(run_chunks(KERNEL, items(numbers), engine, skip=frozenset({1, 4})))
    assert [number for number, _, _ in chunks] == [0, 2, 3]
    assert [members.tolist() for _, members, _ in chunks] == [list(range(5)), list(range(10, 15)), list(range(15, 20))]
    order = np.arange(23)[::-1].copy()
    members = np.concatenate([m for _, m, _ in run_chunks(KERNEL, items(numbers), engine, order)])
    np.testing.assert_array_equal(members, order)


@pytest.mark.parametrize("name", ["cores", "lanes"])
def test_one_compilation_whatever_the_count_and_the_values(name: str) -> None:
    traces = []

    class Counted(Collatz):
        def step(self, state: dict) -> dict:
            traces.append(1)
            return super().step(state)

    engine = Engine(name, lanes=8, chunk=32)  # type: ignore[arg-type]
    run(Counted(np.asarray(3, np.int32)), items(np.arange(1, 70)), engine)
    first = len(traces)
    assert first > 0
    run(Counted(np.asarray(3, np.int32)), items(np.arange(1, 9)), engine)
    run(Counted(np.asarray(1, np.int32)), items(np.arange(1, 200)), engine)  # another value, another result
    assert len(traces) == first


def test_memory_is_that_of_a_chunk() -> None:
    """What the compiled program holds does not depend on the number of items: it never sees more than a chunk."""
    engine = Engine("cores", chunk=6)
    sizes = [len(members) for _, members, _ in run_chunks(KERNEL, items(np.arange(1, 21)), engine)]
    assert sizes == [6, 6, 6, 2]
    with pytest.raises(ValueError, match="7 items do not fit a chunk of 6"):
        run_chunk(KERNEL, items(np.arange(1, 8)), engine)
    # the program's own account of what it holds: a chunk of 6 items with 4 + 16 bytes each, and little else
    devices = len(jax.devices())
    capacity = -(-6 // devices) * devices
    program = lanes._cores(devices, True).lower(KERNEL, items(np.ones(capacity)), np.zeros(devices, np.int32)).compile()
    memory = program.memory_analysis()
    assert memory.argument_size_in_bytes + memory.output_size_in_bytes + memory.temp_size_in_bytes < 4096


def test_dealing_and_collecting_are_inverse() -> None:
    rows = np.arange(24).reshape(12, 2)
    dealt = lanes._deal(rows, 3)
    np.testing.assert_array_equal(dealt[:4], rows[0::3])
    np.testing.assert_array_equal(lanes._collect(dealt.reshape(3, 4, 2)), rows)


def test_no_host_transfer_within_a_chunk() -> None:
    """Once the arrays are on the device, a chunk runs to its end without a round trip to the host."""
    engine = Engine("lanes", lanes=8, chunk=32)
    kernel = jax.device_put(KERNEL)
    device_items, count = jax.device_put(items(np.arange(1, 33))), jax.device_put(np.int32(32))
    with jax.transfer_guard("disallow"):
        results = lanes._lanes(True)(kernel, device_items, count, engine.lanes, engine.steps_per_round)
        jax.block_until_ready(results)
    check(np.arange(1, 33), jax.tree.map(np.asarray, results))


def test_bad_engines_are_refused() -> None:
    for name in ("lanes", "chunk", "steps_per_round"):
        with pytest.raises(ValueError, match=f"{name} must be at least 1, not 0"):
            Engine(**{name: 0})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="at least one item"):
        run(KERNEL, items(np.zeros(0)), Engine("cores"))


def test_auto_is_cores_on_cpu() -> None:
    assert Engine().resolved() == ("cores" if jax.default_backend() == "cpu" else "lanes")
    assert Engine("lanes").resolved() == "lanes"
    assert isinstance(Engine(), eqx.Module)
