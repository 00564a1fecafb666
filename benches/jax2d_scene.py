"""Builds Jax2D states from `iplw.scene/1` scenes that differ only in their initial positions, and rolls them out as a batch.

Jax2D 1.0.2 from PyPI with its defaults (10 iterations, warm starting, all pairs, f32), without pairs of statics. It requires at least
two discs, one joint and one thruster, which stay inactive.
"""

import jax
import jax.numpy as jnp
from jax2d.engine import PhysicsEngine, create_empty_sim
from jax2d.scene import add_rectangle_to_scene
from jax2d.sim_state import SimParams, StaticSimParams


class PolygonsOnly(PhysicsEngine):
    """Physics engine without disc contacts and joints, which the scenes lack."""

    def __init__(self, static):
        super().__init__(static)
        self.cr_fn = self.cc_fn = lambda state, manifolds, params: (state, manifolds)
        self.ws_cr_fn = self.ws_cc_fn = lambda state, manifolds: state
        self.j_fn = lambda state, params: state
        self.ws_j_fn = lambda state: state


def sizes(scene, solved_at_once):
    """Static sizes for compilation; `solved_at_once` pairs are solved in parallel, with their impulses summed."""
    return StaticSimParams(num_polygons=len(scene["bodies"]) + len(scene["statics"]), num_circles=2, num_joints=1,
                           num_thrusters=1, num_static_fixated_polys=len(scene["statics"]), solver_batch_size=solved_at_once)


def start(scenes, static):
    """One state with a leading axis of scenes: statics first, then the bodies in their order."""
    first = scenes[0]
    state = create_empty_sim(static, add_floor=False, add_walls_and_ceiling=False)
    state = state.replace(gravity=jnp.array(first["gravity"]))
    for own in [*first["statics"], *first["bodies"]]:
        shape = own["shape"]
        if shape["type"] != "box":
            raise ValueError(f"no Jax2D shape for {shape['type']}")
        dimensions = jnp.array([2 * shape["half_width"], 2 * shape["half_height"]])
        state, _ = add_rectangle_to_scene(
            state, static, jnp.array(own["position"], dtype=float), dimensions, rotation=own.get("angle", 0.0),
            density=own.get("density", 1.0), friction=own["friction"], restitution=own["restitution"],
            fixated="density" not in own)
    many = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(scenes), *x.shape)), state)
    of = lambda key: jnp.array([[own[key] for own in scene["bodies"]] for scene in scenes])
    moved = slice(len(first["statics"]), None)
    return many.replace(polygon=many.polygon.replace(
        position=many.polygon.position.at[:, moved].set(of("position")),
        rotation=many.polygon.rotation.at[:, moved].set(of("angle"))))


def rollouts(scene, static, engine):
    """A compiled function from states to body positions, m, and angles, rad, at every observation."""
    params = SimParams(dt=scene["time_step"])
    none = jnp.zeros(static.num_joints + static.num_thrusters)

    def observe(state, _):
        state, _ = jax.lax.scan(lambda s, _: (engine.step(s, params, none)[0], None), state, None, scene["observe_every"])
        return state, (state.polygon.position, state.polygon.rotation)

    def roll_out(state):
        return jax.lax.scan(observe, state, None, scene["steps"] // scene["observe_every"])[1]

    return jax.jit(jax.vmap(roll_out))
