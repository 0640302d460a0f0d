"""One update of the learner, computed with NumPy in float64, as the reference for tests/it/reference.rs.

Usage: python3 generate_update.py            writes update_default.safetensors and update_plain.safetensors beside itself

`default` has a critic with layer normalisation and an action map, as a training has. `plain` has neither.

Each file holds the learner's checkpoint before (`before.*`) and after (`after.*`) the update, the minibatch (`batch.*`),
the action map (`map.*`) and the logged numbers (`stats.*`). Written from the equations (Lillicrap et al. 2016, Ba et
al. 2016, Kingma and Ba 2015, OpenAI baselines HER, docs/algorithms.md), not from the Rust code.
"""

import json
import pathlib
import struct

import numpy as np

OBS, GOAL, ACT, BATCH, HIDDEN = 4, 2, 3, 6, [8, 8]
GAMMA, TAU, ACTION_L2 = 0.9, 0.05, 0.7
ACTOR_LR, CRITIC_LR = 2e-3, 3e-3
BETA1, BETA2, ADAM_EPSILON = 0.9, 0.999, 1e-8
NORM_EPSILON, NORM_CLIP, RAW_CLIP = 0.01, 1.5, 3.0
# Widens the target critic's values so that some targets are clipped at either end.
TARGET_SPREAD = 16
ADAM_STEPS_BEFORE, UPDATES_BEFORE = 3, 3
AVERAGE_UPDATES = 3
LAYER_NORM_EPSILON = 1e-5
# Widens the map so that some actions are clamped.
MAP_SPREAD = 1.5


def rounded(x):
    """The nearest numbers that single precision holds, so that both sides start alike."""
    return np.asarray(x, np.float32).astype(np.float64)


class Net:
    def __init__(self, rng, sizes, tanh=False, layer_norm=False):
        self.tanh, self.layer_norm = tanh, layer_norm
        self.w = [rounded(rng.normal(0, 0.5, (o, i))) for i, o in zip(sizes[:-1], sizes[1:])]
        self.b = [rounded(rng.normal(0, 0.1, o)) for o in sizes[1:]]

    def forward(self, x):
        self.inputs, self.normalized, self.deviations = [], [], []
        for i, (w, b) in enumerate(zip(self.w, self.b)):
            self.inputs.append(x)
            x = x @ w.T + b
            if i + 1 < len(self.w):
                if self.layer_norm:
                    deviation = np.sqrt(x.var(axis=1, keepdims=True) + LAYER_NORM_EPSILON)
                    x = (x - x.mean(axis=1, keepdims=True)) / deviation
                    self.normalized.append(x)
                    self.deviations.append(deviation)
                x = np.maximum(x, 0)
        self.out = np.tanh(x) if self.tanh else x
        return self.out

    def backward(self, d):
        """Gradients by weights, biases and input."""
        if self.tanh:
            d = d * (1 - self.out**2)
        gw, gb = [], []
        for i in reversed(range(len(self.w))):
            gw.insert(0, d.T @ self.inputs[i])
            gb.insert(0, d.sum(0))
            d = d @ self.w[i]
            if i > 0:
                d = d * (self.inputs[i] > 0)
                if self.layer_norm:
                    n = self.normalized[i - 1]
                    slope = np.mean(d * n, axis=1, keepdims=True)
                    d = (d - d.mean(axis=1, keepdims=True) - n * slope) / self.deviations[i - 1]
        return gw, gb, d

    def params(self):
        return self.w + self.b


class Learned:
    def __init__(self, rng, sizes, lr, **kind):
        self.net, self.target, self.lr = Net(rng, sizes, **kind), Net(rng, sizes, **kind), lr
        self.m = [rounded(rng.normal(0, 0.05, p.shape)) for p in self.net.params()]
        self.v = [rounded(rng.uniform(0.001, 0.01, p.shape)) for p in self.net.params()]
        self.t = ADAM_STEPS_BEFORE

    def step(self, gw, gb):
        self.t += 1
        for p, g, m, v in zip(self.net.params(), gw + gb, self.m, self.v):
            m += (1 - BETA1) * (g - m)
            v += (1 - BETA2) * (g * g - v)
            p -= self.lr * (m / (1 - BETA1**self.t)) / (np.sqrt(v / (1 - BETA2**self.t)) + ADAM_EPSILON)

    def follow(self):
        for target, p in zip(self.target.params(), self.net.params()):
            target += TAU * (p - target)

    def tensors(self, name):
        out = {}
        n = len(self.net.w)
        for prefix, arrays in [
            (name, self.net.params()),
            (f"{name}_target", self.target.params()),
            (f"{name}_adam.first_moment", self.m),
            (f"{name}_adam.second_moment", self.v),
        ]:
            for i in range(n):
                out[f"{prefix}.{i}.weight"] = np.float32(arrays[i])
                out[f"{prefix}.{i}.bias"] = np.float32(arrays[n + i])
        out[f"{name}_adam.n_steps"] = np.array([self.t], np.uint64)
        out[f"{name}_adam.learning_rate"] = np.array([self.lr], np.float32)
        return out


class Normalizer:
    def __init__(self, rng, dim):
        rows = np.clip(rounded(rng.normal(0.3, 1.2, (50, dim))), -RAW_CLIP, RAW_CLIP)
        rows[:, 0] = 0.25
        self.count, self.sum, self.squares = len(rows), rows.sum(0), (rows**2).sum(0)

    def __call__(self, x):
        mean = self.sum / self.count
        std = np.sqrt(np.maximum(self.squares / self.count - mean**2, NORM_EPSILON**2))
        return np.clip((np.clip(x, -RAW_CLIP, RAW_CLIP) - mean) / std, -NORM_CLIP, NORM_CLIP)

    def tensors(self, name):
        return {
            f"{name}.count": np.array([self.count], np.uint64),
            f"{name}.sum": self.sum,
            f"{name}.sum_of_squares": self.squares,
        }


class ActionMap:
    """action = clip(matrix @ output + offset, -1, 1)"""

    def __init__(self, rng):
        self.matrix = rounded(np.eye(ACT) + MAP_SPREAD * rng.normal(0, 0.3, (ACT, ACT)))
        self.offset = rounded(rng.normal(0, 0.3, ACT))

    def forward(self, output):
        return np.clip(output @ self.matrix.T + self.offset, -1, 1)

    def backward(self, action, d):
        """Gradient by the output; a clamped action has none."""
        return np.where(np.abs(action) < 1, d, 0) @ self.matrix


class Identity:
    def forward(self, output):
        return output

    def backward(self, action, d):
        return d


def checkpoint(actor, average, critic, observation, goal, n_updates):
    out = {"schema": np.array([2], np.uint64), "n_updates": np.array([n_updates], np.uint64)}
    out |= actor.tensors("actor")
    for i, (w, b) in enumerate(zip(average.w, average.b)):
        out |= {f"actor_average.{i}.weight": np.float32(w), f"actor_average.{i}.bias": np.float32(b)}
    out |= critic.tensors("critic")
    return out | observation.tensors("observation") | goal.tensors("goal")


def write(path, tensors):
    types = {np.dtype(np.float32): "F32", np.dtype(np.float64): "F64", np.dtype(np.uint64): "U64"}
    # The format wants each tensor aligned: the widest element types come first.
    order = sorted(tensors, key=lambda name: (-tensors[name].dtype.itemsize, name))
    header, data = {}, b""
    for name in order:
        start, tensor = len(data), np.ascontiguousarray(tensors[name])
        data += tensor.tobytes()
        header[name] = {"dtype": types[tensor.dtype], "shape": list(tensor.shape), "data_offsets": [start, len(data)]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(struct.pack("<Q", len(text)) + text + data)


def generate(path, seed, default):
    rng = np.random.default_rng(seed)
    state = OBS + GOAL
    actor = Learned(rng, [state, *HIDDEN, ACT], ACTOR_LR, tanh=True)
    critic = Learned(rng, [state + ACT, *HIDDEN, 1], CRITIC_LR, layer_norm=default)
    critic.target.w[-1] *= TARGET_SPREAD
    observation, goal = Normalizer(rng, OBS), Normalizer(rng, GOAL)
    batch = {
        "observations": rounded(rng.normal(0, 2, (BATCH, OBS))),
        "goals": rounded(rng.normal(0, 2, (BATCH, GOAL))),
        "actions": rounded(rng.uniform(-1, 1, (BATCH, ACT))),
        "rewards": rounded(rng.uniform(-1, 0, BATCH)),
        "next_observations": rounded(rng.normal(0, 2, (BATCH, OBS))),
    }
    average = Net(rng, [state, *HIDDEN, ACT], tanh=True)
    action_map = ActionMap(rng) if default else Identity()
    before = checkpoint(actor, average, critic, observation, goal, UPDATES_BEFORE)
    tensors = {f"before.{k}": v for k, v in before.items()}
    tensors |= {f"batch.{k}": np.float32(v) for k, v in batch.items()}
    if default:
        tensors |= {"map.matrix": np.float32(action_map.matrix), "map.offset": np.float32(action_map.offset)}

    s = np.hstack([observation(batch["observations"]), goal(batch["goals"])])
    s_next = np.hstack([observation(batch["next_observations"]), goal(batch["goals"])])
    x_next = np.hstack([s_next, action_map.forward(actor.target.forward(s_next))])
    raw = batch["rewards"] + GAMMA * critic.target.forward(x_next)[:, 0]
    target = np.clip(raw, -1 / (1 - GAMMA), 0)

    assert (raw > 0).any() and (raw < -1 / (1 - GAMMA)).any() and (raw == target).any(), "choose another seed"

    q = critic.net.forward(np.hstack([s, batch["actions"]]))[:, 0]
    critic_loss, q_mean = np.mean((q - target) ** 2), np.mean(q)
    gw, gb, _ = critic.net.backward((2 * (q - target) / BATCH)[:, None])
    critic.step(gw, gb)

    pi = actor.net.forward(s)
    action = action_map.forward(pi)
    clamped = np.abs(action) >= 1
    assert not default or (clamped.any() and not clamped.all(axis=0).any()), "choose another seed"
    q_pi = critic.net.forward(np.hstack([s, action]))
    actor_loss = -np.mean(q_pi) + ACTION_L2 * np.mean(pi**2)
    _, _, dx = critic.net.backward(np.full_like(q_pi, -1 / BATCH))
    gw, gb, _ = actor.net.backward(action_map.backward(action, dx[:, state:]) + 2 * ACTION_L2 * pi / pi.size)
    actor.step(gw, gb)
    for learned in [actor, critic]:
        learned.follow()
    share = 1 / min(AVERAGE_UPDATES, UPDATES_BEFORE + 1)
    for mean, p in zip(average.params(), actor.net.params()):
        mean += share * (p - mean)

    after = checkpoint(actor, average, critic, observation, goal, UPDATES_BEFORE + 1)
    tensors |= {f"after.{k}": v for k, v in after.items()}
    stats = {
        "critic_loss": critic_loss,
        "actor_loss": actor_loss,
        "q_mean": q_mean,
        "target_mean": np.mean(target),
        "clipped_share": np.mean(raw != target),
        "action_square_mean": np.mean(pi**2),
    }
    print(path.name, stats)
    tensors |= {f"stats.{k}": np.array([v]) for k, v in stats.items()}
    write(path, tensors)


if __name__ == "__main__":
    here = pathlib.Path(__file__).parent
    generate(here / "update_default.safetensors", 7, True)
    generate(here / "update_plain.safetensors", 6, False)
