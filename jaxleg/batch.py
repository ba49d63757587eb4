"""Lanes over devices, and many loops of different length over few lanes.

Lanes are compiled once for one chunk and shared out over all devices of this process. On a CPU, start JAX with a device a core
(`jax_num_cpu_devices`; the command line does): each core then runs its own lanes through small arrays that stay in its cache,
instead of XLA splitting each operation over the cores.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxleg.programs import Kept, kept


@dataclasses.dataclass(frozen=True)
class Picked:
    """Lanes of these numbers of a tree (leading axis), some perhaps several times: as an argument of a batched function they
    are looked up chunk by chunk, so that lanes with one map in common hold no copies of it."""

    tree: Any
    index: np.ndarray  # (lane,)

    @property
    def shape(self) -> tuple[int, ...]:
        """Their number, alone."""
        return self.index.shape

    def __getitem__(self, lanes: Any) -> Any:
        """The tree of some of the lanes."""
        return jax.tree.map(lambda x: np.asarray(x)[self.index[lanes]], self.tree)


def over_lanes(
    lane: Callable[..., Any], chunk: int, devices: int | None = None, where: Kept | None = None
) -> Callable[..., Any]:
    """The function of one lane over a leading axis of its arguments, `chunk` lanes a device at a time; see `shared_out`."""
    return shared_out(jax.vmap(lane), chunk, devices, where)


def shared_out(
    batch: Callable[..., Any], chunk: int, devices: int | None = None, where: Kept | None = None
) -> Callable[..., Any]:
    """A function over a leading axis of its arguments, its lanes shared out over devices (all), `chunk` a device at a time.

    Every call, of few lanes too, is filled up to whole chunks, so that all share one compiled program: where a lane is
    expensive, let `layout` choose. What it is called with as `common=(...)` comes first among its arguments, whole on every
    device.
    """
    shared = on_devices(batch, devices, where)
    lanes = chunk * len(jax.local_devices()[:devices])

    def call(*batched: Any, common: tuple = ()) -> Any:
        return in_chunks(lambda *lanes: shared(common, lanes), lanes, *batched)

    return call


def on_devices(
    batch: Callable[..., Any], devices: int | None = None, where: Kept | None = None
) -> Callable[[tuple, tuple], Any]:
    """The compiled function (common, lanes) of one chunk: `common` whole on every device, the lanes in equal shares on all.

    What is called one after the other within a chunk shares its programs with others, and stays on the devices between. Its
    programs are kept `where` it is said.
    """
    mesh = jax.sharding.Mesh(np.array(jax.local_devices()[:devices]), ("lane",))
    whole, along = jax.sharding.PartitionSpec(), jax.sharding.PartitionSpec("lane")

    @jax.jit
    @functools.partial(jax.shard_map, mesh=mesh, in_specs=(whole, along), out_specs=along, check_vma=False)
    def shared(common, lanes):
        return batch(*common, *lanes)

    if where is None:
        return shared
    of_common, of_lanes = (jax.sharding.NamedSharding(mesh, spec) for spec in (whole, along))
    return kept(shared, where, (of_common, of_lanes), of_lanes)


def layout(count: int, most: int) -> tuple[int, int]:
    """Lanes a device at a time, at most `most`, and devices, for `count` lanes: fewer than one a device and round too many."""
    devices = max(1, min(jax.local_device_count(), count))
    rounds = max(1, -(-count // (devices * most)))
    return max(1, -(-count // (devices * rounds))), devices


def in_chunks(function: Callable[..., Any], chunk: int, *batched: Any) -> Any:
    """Call a compiled batch function on chunks of one size (the last one padded by its last lane) and join the results.

    What is batched has a leading axis or is `Picked`. Results are NumPy arrays: memory is that of one chunk, whatever their
    number.
    """
    count = jax.tree.leaves(batched)[0].shape[0]
    if not count:
        return _nothing(function, chunk, _lanes(batched, slice(None)))
    batched = jax.tree.map(lambda x: x if isinstance(x, Picked) else np.asarray(x), batched)  # NumPy picks without compiling
    parts = []
    for start in range(0, count, chunk):
        kept = min(chunk, count - start)
        part = function(*_lanes(batched, np.minimum(np.arange(start, start + chunk), count - 1)))
        parts.append(_lanes(jax.tree.map(np.asarray, part), slice(kept)))
    return jax.tree.map(lambda *x: np.concatenate(x), *parts)


def _nothing(function, chunk, batched):
    """What a batch function returns, without a lane."""
    full = jax.tree.map(lambda x: jax.ShapeDtypeStruct((chunk, *x.shape[1:]), x.dtype), batched)
    return jax.tree.map(lambda x: np.zeros((0, *x.shape[1:]), x.dtype), jax.eval_shape(function, *full))


def _lanes(tree, index):
    return jax.tree.map(lambda x: x[index], tree)


def over_queue(
    begin: Callable[[Any], Any],
    advance: Callable[[Any, Any], Any],
    going: Callable[[Any], Bool[Array, ""]],
    items: Any,
    lanes: int,
) -> Any:
    """The last state of `while going(state): state = advance(item, state)` from `begin(item)`, for every item.

    A lane that is done takes the next item of the queue: `vmap` of a `while_loop` would run every lane for as long as the
    slowest. All functions are of one item; `items` and the result have a leading axis.
    """
    count = jax.tree.leaves(items)[0].shape[0]
    lanes = min(lanes, count)

    def of(index):
        return jax.tree.map(lambda x: x[jnp.minimum(index, count - 1)], items)

    def proceed(carry):
        """Every lane one step on; one that is done writes its result and takes the next item."""
        index, item, state, upcoming, results = carry
        state = _where(jax.vmap(going)(state), jax.vmap(advance)(item, state), state)
        done = ~jax.vmap(going)(state)
        results = jax.tree.map(lambda r, s: r.at[jnp.where(done, index, count)].set(s, mode="drop"), results, state)
        index = jnp.where(done, upcoming + jnp.cumsum(done) - 1, index)
        item, fresh = _where(done, of(index), item), jax.vmap(begin)(of(index))
        return index, item, _where(done, fresh, state), upcoming + jnp.sum(done), results

    index = jnp.arange(lanes)
    state = jax.vmap(begin)(of(index))
    results = jax.tree.map(lambda s: jnp.zeros((count, *s.shape[1:]), s.dtype), state)
    carry = (index, of(index), state, jnp.asarray(lanes, index.dtype), results)
    return jax.lax.while_loop(lambda carry: jnp.any(carry[0] < count), proceed, carry)[-1]


def _where(mask, new, old):
    return jax.tree.map(lambda a, b: jnp.where(mask.reshape(-1, *(1,) * (a.ndim - 1)), a, b), new, old)
