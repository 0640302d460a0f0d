"""Updates a second of a DDPG in JAX on one thread of the CPU, one compiled call for each.

The networks, the batch and the sizes are those of this project's learner, as in `sb3_update.py`: three hidden layers of
256 for actor and critic, float32, Adam. An update draws a minibatch from a replay that JAX holds, and updates critic,
actor and both targets, all in one function that XLA has compiled and that may overwrite its input. `jax_scan_update.py`
does many in a call. Inputs and hidden layers are not normalised. The last line printed is a JSON document.
"""

import argparse
import json
import os
import time

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["NPROC"] = "1"
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import jax.numpy as jnp

BUFFER = 100_000
CHUNK = 10
HIDDEN = [256, 256, 256]
GAMMA, TAU, RATE, ACTION_L2 = 0.98, 0.005, 1e-3, 1.0
BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8


def network(key, sizes):
    keys = jax.random.split(key, len(sizes) - 1)
    layers = zip(keys, sizes, sizes[1:])
    return [(jax.random.normal(k, (i, o)) * (2 / i) ** 0.5, jnp.zeros(o)) for k, i, o in layers]


def forward(layers, x):
    for weight, bias in layers[:-1]:
        x = jax.nn.relu(x @ weight + bias)
    weight, bias = layers[-1]
    return x @ weight + bias


def act(actor, state):
    return jnp.tanh(forward(actor, state))


def value(critic, state, action):
    return forward(critic, jnp.concatenate([state, action], axis=1))[:, 0]


def adam(parameters, moments, gradients, count):
    first = jax.tree.map(lambda m, g: BETA1 * m + (1 - BETA1) * g, moments[0], gradients)
    second = jax.tree.map(lambda v, g: BETA2 * v + (1 - BETA2) * g * g, moments[1], gradients)
    rate = RATE * jnp.sqrt(1 - BETA2**count) / (1 - BETA1**count)
    step = jax.tree.map(lambda p, m, v: p - rate * m / (jnp.sqrt(v) + EPSILON), parameters, first, second)
    return step, (first, second)


def update(replay, batch, state):
    key, draw = jax.random.split(state["key"])
    rows = jax.random.randint(draw, (batch,), 0, BUFFER)
    now, following, action, reward = (array[rows] for array in replay)
    ahead = value(state["target_critic"], following, act(state["target_actor"], following))
    target = jnp.clip(reward + GAMMA * ahead, -1 / (1 - GAMMA), 0)

    def critic_loss(critic):
        return jnp.mean((value(critic, now, action) - target) ** 2)

    def actor_loss(actor, critic):
        chosen = act(actor, now)
        return -jnp.mean(value(critic, now, chosen)) + ACTION_L2 * jnp.mean(chosen**2)

    count = state["count"] + 1
    gradients = jax.grad(critic_loss)(state["critic"])
    critic, critic_moments = adam(state["critic"], state["critic_moments"], gradients, count)
    gradients = jax.grad(actor_loss)(state["actor"], critic)
    actor, actor_moments = adam(state["actor"], state["actor_moments"], gradients, count)

    def follow(slow, fast):
        return jax.tree.map(lambda s, f: s + TAU * (f - s), slow, fast)

    return {
        "key": key,
        "count": count,
        "actor": actor,
        "critic": critic,
        "actor_moments": actor_moments,
        "critic_moments": critic_moments,
        "target_actor": follow(state["target_actor"], actor),
        "target_critic": follow(state["target_critic"], critic),
    }


def start(options):
    """Returns a state and a replay of noise."""
    key, *keys = jax.random.split(jax.random.key(0), 7)
    inputs = options.obs + options.goal
    actor = network(keys[0], [inputs, *HIDDEN, options.act])
    critic = network(keys[1], [inputs + options.act, *HIDDEN, 1])

    def zeros(layers):
        return jax.tree.map(jnp.zeros_like, (layers, layers))

    def noise(key, width):
        return jax.random.uniform(key, (BUFFER, width), minval=-1, maxval=1)

    replay = (noise(keys[2], inputs), noise(keys[3], inputs), noise(keys[4], options.act))
    reward = -jax.random.bernoulli(keys[5], 0.5, (BUFFER,)).astype(jnp.float32)
    state = {"key": key, "count": jnp.zeros((), jnp.int32), "actor": actor, "critic": critic}
    state |= {"actor_moments": zeros(actor), "critic_moments": zeros(critic)}
    # Copies, because a donated buffer must not be named twice.
    state |= {"target_actor": jax.tree.map(jnp.copy, actor), "target_critic": jax.tree.map(jnp.copy, critic)}
    return state, (*replay, reward)


def main(scan=False):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--obs", type=int, default=64)
    parser.add_argument("--goal", type=int, default=3)
    parser.add_argument("--act", type=int, default=21)
    options = parser.parse_args()

    state, replay = start(options)

    def one(state, replay):
        return update(replay, options.batch, state)

    def many(state, replay):
        return jax.lax.scan(lambda s, _: (one(s, replay), None), state, length=CHUNK)[0]

    compiled = jax.jit(many if scan else one, donate_argnums=0)
    calls = 1 if scan else CHUNK
    state = jax.block_until_ready(compiled(state, replay))
    updates, begin, used = 0, time.perf_counter(), time.process_time()
    while time.perf_counter() - begin < options.seconds:
        for _ in range(calls):
            state = compiled(state, replay)
        jax.block_until_ready(state)
        updates += CHUNK
    seconds = time.perf_counter() - begin
    record = {
        "updates_per_s": updates / seconds,
        "cores_used": (time.process_time() - used) / seconds,
        "jax": jax.__version__,
    }
    print(json.dumps(record))


if __name__ == "__main__":
    main()
