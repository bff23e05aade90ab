"""One registration as init / step / done / finish: the thesis's ICP (§2.3 - 2.7, annex B) and plainer ones as configs.

Coordinates are centred (``problem.py``), float32, structure of arrays. A pose is held as R, t with
``p_target = R p_source + t`` and refitted from the source's own coordinates in each iteration, which is the same as
``T^{k+1} = dT^k T^k`` (§2.3, ERRATA) without accumulating rounding.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.nearest import gather
from jaxmodel.geometry.rigid_fit import Moments
from jaxmodel.lanes import Kernel
from jaxmodel.register.estimation import fit_point_to_plane, fit_point_to_point
from jaxmodel.register.method import IcpMethod, Strategy
from jaxmodel.register.outcome import Outcome
from jaxmodel.register.pairing import Clusters, Pairs, find_pairs
from jaxmodel.register.problem import Problem
from jaxmodel.register.rejection import sum_over_points, zhang_limit

RUNNING = -1
FEWEST_PAIRS = 4
ROUNDING = 2.5e-7  # what float32 leaves undecided of a mean distance, in sizes of the target


class Pose(eqx.Module):
    """``p_target = rotation p_source + translation`` in centred coordinates."""

    rotation: Float[AnyArray, "*batch 3 3"]
    translation: Float[AnyArray, "*batch 3"]

    def move(self, points: Float[jax.Array, "3 n"]) -> Float[jax.Array, "3 n"]:
        # by elements, not by a matrix product: both executors must round alike
        x, y, z = points
        rows = zip(self.rotation, self.translation, strict=True)
        return jnp.stack([r[0] * x + r[1] * y + r[2] * z + t for r, t in rows])


class IcpState(eqx.Module):
    """What one registration carries from iteration to iteration. ``outcome`` is RUNNING until it ends."""

    pose: Pose
    clusters: Clusters
    limit: Float[jax.Array, ""]  # Zhang's distance limit of the previous iteration
    error: Float[jax.Array, ""]  # mean distance of the kept pairs at the last pairing
    first_error: Float[jax.Array, ""]
    matched_fraction: Float[jax.Array, ""]
    strategy: Int[jax.Array, ""]
    steps: Int[jax.Array, ""]
    switches: Int[jax.Array, "2"]  # iteration at which strategies 1 and 2 began; 0: never
    increases: Int[jax.Array, ""]  # iterations in which the error rose within a strategy
    outcome: Int[jax.Array, ""]


class IcpResult(eqx.Module):
    """What is kept of one registration; the error and fractions are those of the returned pose."""

    pose: Pose
    error: Float[jax.Array, ""]
    matched_fraction: Float[jax.Array, ""]
    shared_rate: Float[jax.Array, ""]
    steps: Int[jax.Array, ""]
    switches: Int[jax.Array, "2"]
    increases: Int[jax.Array, ""]
    outcome: Int[jax.Array, ""]


class Icp(Kernel):
    """ICP on one problem by one method; an item is a starting ``Pose``."""

    problem: Problem
    method: IcpMethod

    @property
    def reorders_sums(self) -> bool:
        return not self.method.stores_pairs

    def init(self, item: Pose) -> IcpState:
        zero = jnp.zeros((), jnp.int32)
        infinite = jnp.float32(jnp.inf)
        zhang = self.method.zhang
        limit = infinite if zhang is None else jnp.float32(zhang.initial * zhang.scale) * self.problem.resolution
        return IcpState(
            pose=item,
            clusters=self.joint_clusters(item),
            limit=limit,
            error=infinite,
            first_error=infinite,
            matched_fraction=jnp.float32(0),
            strategy=zero,
            steps=zero,
            switches=jnp.zeros(2, jnp.int32),
            increases=zero,
            outcome=jnp.where(jnp.all(jnp.isfinite(item.translation)), RUNNING, Outcome.NOT_FINITE).astype(jnp.int32),
        )

    def done(self, state: IcpState) -> Bool[jax.Array, ""]:
        return state.outcome != RUNNING

    def step(self, state: IcpState) -> IcpState:
        branches = [lambda s, n=number: self._step_with(n, s) for number in range(len(self.method.strategies))]
        return branches[0](state) if len(branches) == 1 else jax.lax.switch(state.strategy, branches, state)

    def finish(self, state: IcpState) -> IcpResult:
        # the state's error belongs to the pairing before the last fit: pair once more at the pose that is returned
        last = self.method.strategies[-1]
        clusters = self.joint_clusters(state.pose)
        pairs, _ = self.pairs(last, eqx.tree_at(lambda s: s.clusters, state, clusters))
        error, matched = self._error(pairs)
        return IcpResult(
            pose=state.pose,
            error=error,
            matched_fraction=matched,
            shared_rate=self.shared_rate(state.pose, clusters),
            steps=state.steps,
            switches=state.switches,
            increases=state.increases,
            outcome=state.outcome,
        )

    def pairs(self, strategy: Strategy, state: IcpState) -> tuple[Pairs, Float[jax.Array, ""]]:
        """The kept pairs at the state's pose under one strategy, and the new limit of Zhang's filter."""
        problem, method = self.problem, self.method
        furthest = jnp.float32(jnp.inf) if method.max_distance is None else method.max_distance * problem.size
        filtered = method.filters(strategy)

        def search() -> Pairs:
            return find_pairs(
                strategy,
                problem.fast_table,
                problem.exact_table,
                problem.target,
                state.pose.move(problem.source),
                problem.mask,
                state.clusters,
                furthest,
            )

        # The filter reads the pairs twice. The result of a branch is stored, where plain array code would be folded
        # into both readers and every closest point looked up again; the other branch never runs.
        pairs = jax.lax.cond(state.steps >= 0, search, lambda: _no_pairs(problem)) if filtered else search()
        kept = pairs.kept
        if method.border_filter:
            kept &= ~gather(problem.border, pairs.index)
        limit = state.limit
        if filtered:
            assert method.zhang is not None
            limit = zhang_limit(pairs.distance, kept, method.zhang.scale * problem.resolution, state.limit)
            kept &= (pairs.distance < state.limit) & (pairs.distance <= limit)
        return Pairs(pairs.index, pairs.point, pairs.distance, kept), limit

    def joint_clusters(self, pose: Pose) -> Clusters:
        """Clusters over the joint box of both clouds at a pose; their edge is its longest edge / ``clusters``."""
        moved = pose.move(self.problem.source)
        low = jnp.min(jnp.where(self.problem.mask, moved, jnp.inf), axis=1)
        high = jnp.max(jnp.where(self.problem.mask, moved, -jnp.inf), axis=1)
        low, high = jnp.minimum(low, self.problem.box[0]), jnp.maximum(high, self.problem.box[1])
        return Clusters(low, jnp.max(high - low) / self.method.clusters)

    def shared_rate(self, pose: Pose, clusters: Clusters) -> Float[jax.Array, ""]:
        """Clusters that hold points of both clouds / clusters that hold points of either (ERRATA, fig. 2.23)."""
        count = self.method.clusters + 1  # points on the box's far faces fall into the extra layer

        def occupied(points: jax.Array, mask: jax.Array) -> jax.Array:
            cell = jnp.clip((points - clusters.origin[:, None]) / clusters.edge, 0, count - 1).astype(jnp.int32)
            key = (cell[0] * count + cell[1]) * count + cell[2]
            return jnp.zeros(count**3, bool).at[key].max(mask)

        ours = occupied(pose.move(self.problem.source), self.problem.mask)
        theirs = occupied(self.problem.target, self.problem.target_mask)
        return jnp.sum(ours & theirs) / jnp.maximum(jnp.sum(ours | theirs), 1).astype(jnp.float32)

    def _error(self, pairs: Pairs) -> tuple[Float[jax.Array, ""], Float[jax.Array, ""]]:
        weight, total = self._sums([pairs.kept.astype(jnp.float32), jnp.where(pairs.kept, pairs.distance, 0.0)])
        return jnp.where(weight > 0, total / jnp.maximum(weight, 1.0), jnp.inf), weight / self.problem.count

    def _sums(self, terms: list[jax.Array]) -> tuple[Float[jax.Array, ""], ...]:
        return sum_over_points(terms, repeatable=self.method.stores_pairs)

    def _sums_of_products(self, p: jax.Array, q: list[jax.Array], pairs: Pairs, pose: Pose) -> tuple[jax.Array, ...]:
        """Sums of w p q^T, w q, w p, w and w d over the pairs, with the same bits in whatever order they are added."""
        w = pairs.kept.astype(jnp.float32)
        weighted = [w * p[0], w * p[1], w * p[2], w]
        terms = [*(a * b for a in weighted for b in q), *weighted, w * pairs.distance]
        if self.method.stores_pairs:
            return sum_over_points(terms, repeatable=True)
        # looking for the largest terms would look up every closest point again, so the clouds' extents bound them
        one, (source, target) = jnp.float32(1), self.problem.reach
        furthest = 1.8 * (source + target) + jnp.sum(jnp.abs(pose.translation))  # 1.8 > sqrt(3)
        bounds = [*(a * b for a in (source,) * 3 + (one,) for b in (target,) * 3), *(source,) * 3, one, furthest]
        return sum_over_points(terms, repeatable=True, bounds=bounds)

    def _step_with(self, number: int, state: IcpState) -> IcpState:
        strategies = self.method.strategies
        strategy, is_last = strategies[number], number == len(strategies) - 1
        pairs, limit = self.pairs(strategy, state)
        pose, error, pair_count, determined = self._fit(pairs, state.pose)
        finite = jnp.all(jnp.isfinite(pose.rotation)) & jnp.all(jnp.isfinite(pose.translation))
        enough = pair_count >= FEWEST_PAIRS
        usable = enough & finite & determined
        first_error = jnp.where(state.steps == 0, error, state.first_error)
        steps = state.steps + 1
        ends = self._ends(strategy, state, pose, error, first_error)
        advance = jnp.array(False) if is_last else usable & ends
        outcome = jnp.where(steps >= self.method.max_iterations, Outcome.MAX_ITERATIONS, RUNNING)
        outcome = jnp.where(ends, Outcome.CONVERGED, outcome) if is_last else outcome
        outcome = jnp.where(determined, outcome, Outcome.DEGENERATE)
        outcome = jnp.where(finite, outcome, Outcome.NOT_FINITE)
        outcome = jnp.where(enough, outcome, Outcome.TOO_FEW_PAIRS)
        pose = jax.tree.map(lambda new, old: jnp.where(usable, new, old), pose, state.pose)
        clusters = state.clusters
        if not is_last and strategies[number + 1].recluster:
            clusters = jax.lax.cond(advance, lambda: self.joint_clusters(pose), lambda: state.clusters)
        return IcpState(
            pose=pose,
            clusters=clusters,
            limit=limit,
            error=error,
            first_error=first_error,
            matched_fraction=pair_count / self.problem.count,
            strategy=state.strategy + advance.astype(jnp.int32),
            steps=steps,
            switches=jnp.where(advance & (jnp.arange(2) == state.strategy), steps, state.switches),
            increases=state.increases + (error > state.error).astype(jnp.int32),
            outcome=outcome.astype(jnp.int32),
        )

    def _ends(
        self, strategy: Strategy, state: IcpState, pose: Pose, error: jax.Array, first_error: jax.Array
    ) -> Bool[jax.Array, ""]:
        if self.method.stop == "slope":
            # annex B.2 asks for a falling error; an exact fixed point must stop too, so: not rising (ERRATA)
            change, rounding = error - state.error, ROUNDING * self.problem.size
            slope_percent = 100.0 * jnp.abs(change) / first_error
            return (change <= rounding) & ((slope_percent < strategy.slope_percent) | (jnp.abs(change) <= rounding))
        # |R' - R|_F = 2 sqrt(2) sin(angle / 2), which stays accurate where the cosine does not
        turned = jnp.sqrt(jnp.sum((pose.rotation - state.pose.rotation) ** 2) / 2.0)
        moved = jnp.sqrt(jnp.sum((pose.translation - state.pose.translation) ** 2))
        return (turned <= jnp.deg2rad(self.method.rotation_tolerance_deg)) & (
            moved <= self.method.translation_tolerance * self.problem.size
        )

    def _fit(self, pairs: Pairs, pose: Pose) -> tuple[Pose, jax.Array, jax.Array, jax.Array]:
        """The refitted pose, the error and number of the pairs it came from, and whether they determine it."""
        problem = self.problem
        w = pairs.kept.astype(jnp.float32)
        q = list(pairs.point)
        if self.method.objective == "point_to_plane":
            assert problem.normals is not None
            normal = [gather(problem.normals[axis], pairs.index) for axis in range(3)]
            moved = pose.move(problem.source)
            fit = fit_point_to_plane(pose.rotation, pose.translation, moved, q, normal, w, self._sums)
            weight, total = self._sums([w, w * pairs.distance])
        else:
            sums = self._sums_of_products(problem.source, q, pairs, pose)
            weight, total = sums[15], sums[16]
            one = 1.0 / jnp.maximum(weight, 1.0)
            source_mean, target_mean = jnp.stack(sums[12:15]) * one, jnp.stack(sums[9:12]) * one
            covariance = jnp.stack(sums[:9]).reshape(3, 3) * one - jnp.outer(source_mean, target_mean)
            fit = fit_point_to_point(Moments(weight, source_mean, target_mean, covariance), self.method.fit)
        error = jnp.where(weight > 0, total / jnp.maximum(weight, 1.0), jnp.inf)
        return Pose(fit.rotation, fit.translation), error, weight, fit.determined


def _no_pairs(problem: Problem) -> Pairs:
    nothing = jnp.zeros(problem.source.shape[1], jnp.float32)
    return Pairs(nothing.astype(jnp.int32), (nothing, nothing, nothing), nothing, nothing > 0)
