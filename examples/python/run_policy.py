"""Runs a trained policy in plain MuJoCo: NumPy and the `mujoco` package, nothing else.

    python run_policy.py RUN [--numbers K] [--object NAME] [--episodes N] [--seed N] [--render FILE.png]

RUN is a run directory, or what `cargo xtask export` wrote. The script first repeats the reference step that the run
recorded, and prints the largest difference of observation, action and next observation. Then it plays episodes and
prints which of them succeed. With --numbers, K numbers command the hand: at every step, the policy's commands are
projected on the mean and the first K components of the run's control synergy.
"""

import argparse
import json
import pathlib
import struct
import sys
import zlib

import mujoco
import numpy as np

try:
    import tomllib
except ModuleNotFoundError:  # Python before 3.11: pip install tomli
    import tomli as tomllib

# The MuJoCo that runs are made with.
RUN_VERSION = "2.2.2"
# Largest difference of the reference step with it, and with a newer one. Newer ones round contacts differently, which
# shows where the hand presses the object (measured with 4.0).
TOLERANCE, NEWER_TOLERANCE = 1e-5, 1e-2
# What newer ones do by default and 2.2.2 does not: they find the contacts of curved shapes in another way.
NEWER_FEATURES = ("mjDSBL_NATIVECCD", "mjDSBL_MULTICCD")
# Distance in m by which the object is moved aside while the hand closes.
AWAY = 0.8


def read_safetensors(path):
    """Reads a safetensors file: 8 bytes of header length, a JSON header, and the arrays."""
    data = pathlib.Path(path).read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    header, body = json.loads(data[8 : 8 + length]), data[8 + length :]
    header.pop("__metadata__", None)
    dtypes = {"F32": np.float32, "F64": np.float64, "U64": np.uint64}
    tensors = {}
    for name, entry in header.items():
        begin, end = entry["data_offsets"]
        tensors[name] = np.frombuffer(body[begin:end], dtypes[entry["dtype"]]).reshape(entry["shape"])
    return tensors


class Policy:
    """The actor: observation and goal in, action in [-1, 1] out."""

    def __init__(self, run):
        self.config = tomllib.loads((run / "policy.toml").read_text())
        tensors = read_safetensors(run / "policy.safetensors")
        self.scaling = {name: (tensors[name + ".mean"], tensors[name + ".std"]) for name in ("observation", "goal")}
        n_layers = sum(name.startswith("actor.") and name.endswith(".bias") for name in tensors)
        self.layers = [(tensors[f"actor.{i}.weight"], tensors[f"actor.{i}.bias"]) for i in range(n_layers)]
        # A policy that was confined to a synergy has a map from its outputs to actions.
        self.map = (tensors["action.matrix"], tensors["action.offset"]) if "action.matrix" in tensors else None
        self.low = np.array([actuator["low"] for actuator in self.config["action"]])
        self.high = np.array([actuator["high"] for actuator in self.config["action"]])
        self.tensors, self.space = tensors, None

    def use_numbers(self, synergy, k):
        """Lets only the first k numbers of a control synergy reach the hand, and tells the policy so."""
        names = [actuator["actuator"] for actuator in self.config["action"]]
        rows = np.array(synergy["components"])
        indices = [names.index(actuator["name"]) for actuator in synergy["actuators"]]
        self.space = indices, np.array(synergy["mean"]), rows[:k]
        if k < len(rows) and "numbers.weight" in self.tensors:
            weight, bias = self.layers[0]
            self.layers[0] = weight, bias + self.tensors["numbers.weight"] / max(k, 1)

    def project(self, action):
        indices, mean, rows = self.space
        low, half = self.low[indices], (self.high - self.low)[indices] / 2
        command = low + (action[indices] + 1) * half
        command = mean + (command - mean) @ rows.T @ rows
        projected = np.array(action, float)
        projected[indices] = np.divide(command - low, half, out=np.ones(len(half)), where=half > 0) - 1
        return projected

    def normalise(self, name, value):
        (mean, std), clip = self.scaling[name], self.config["normalizer"]
        raw = np.clip(np.asarray(value, np.float32), -clip["raw_clip"], clip["raw_clip"])
        return np.clip((raw - mean) / std, -clip["norm_clip"], clip["norm_clip"])

    def act(self, observation, goal):
        x = np.concatenate([self.normalise("observation", observation), self.normalise("goal", goal)])
        for weight, bias in self.layers[:-1]:
            x = np.maximum(weight @ x + bias, 0)
        weight, bias = self.layers[-1]
        output = np.tanh(weight @ x + bias)
        if self.map is not None:
            matrix, offset = self.map
            output = matrix @ output + offset
        if self.space is not None:
            output = self.project(output)
        return np.clip(output, -1, 1)

    def controls(self, action):
        """Maps an action onto the actuators' control ranges."""
        unit = (np.clip(np.asarray(action, float), -1, 1) + 1) / 2
        return self.low + unit * (self.high - self.low)


class Scene:
    """A hand with one object, as the policy sees it."""

    def __init__(self, run, policy, reference):
        self.policy = policy
        self.config = policy.config
        self.model = mujoco.MjModel.from_xml_path(str(run / "scenes" / f"{reference['object']}.xml"))
        for feature in NEWER_FEATURES:
            self.model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, feature, 0))
        self.data = mujoco.MjData(self.model)
        self.start = np.array(reference["qpos"])
        names = self.config["scene"]
        joint = self.id(mujoco.mjtObj.mjOBJ_JOINT, names["object_joint"])
        self.object_qpos, self.object_dof = self.model.jnt_qposadr[joint], self.model.jnt_dofadr[joint]
        self.object_geom = self.id(mujoco.mjtObj.mjOBJ_GEOM, names["object_geom"])
        self.plane_geom = self.id(mujoco.mjtObj.mjOBJ_GEOM, names["plane_geom"])
        hand = self.id(mujoco.mjtObj.mjOBJ_BODY, names["hand_body"])
        self.is_hand = np.array([self.is_below(self.model.geom_bodyid[g], hand) for g in range(self.model.ngeom)])
        # The observation names its joints, so no order has to be known here. The id is the object's number.
        self.sources = [entry["name"] for entry in self.config["observation"]]
        # A policy that was trained without the object's number does not observe it.
        observed = dict(zip(self.sources, reference["observation"]))
        self.object_id = observed.get("object:id")
        body = self.model.geom_bodyid[self.object_geom]
        inertia, self.principal_axes = self.model.body_inertia[body], self.model.body_iquat[body]
        # Half sizes of the box that has the object's mass and inertia.
        self.half_sizes = np.sqrt(np.maximum(1.5 * (inertia.sum() - 2 * inertia) / self.model.body_mass[body], 0))

    def id(self, kind, name):
        found = mujoco.mj_name2id(self.model, kind, name)
        assert found >= 0, f"the scene has no {name}"
        return found

    def is_below(self, body, root):
        while body != root and body != 0:
            body = self.model.body_parentid[body]
        return body == root

    def reset(self, qpos, ctrl):
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.ctrl[:] = qpos, ctrl
        mujoco.mj_forward(self.model, self.data)

    def close(self, share):
        """Returns the positions and controls of the hand closed by a share, with the object moved aside."""
        start, qpos = self.config["start"], self.start.copy()
        ctrl = np.array(start["ctrl"]) + share * np.subtract(start["closed_ctrl"], start["ctrl"])
        for name, position in start["joints"].items():
            qpos[self.model.jnt_qposadr[self.id(mujoco.mjtObj.mjOBJ_JOINT, name)]] = position
        if np.array_equal(ctrl, start["ctrl"]):
            return qpos, ctrl
        qpos[self.object_qpos] += AWAY
        self.reset(qpos, ctrl)
        for _ in range(round(start["closing_time_s"] / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy(), ctrl

    def step(self, action):
        self.data.ctrl[:] = self.policy.controls(action)
        for _ in range(self.config["substeps"]):
            mujoco.mj_step(self.model, self.data)

    def shape(self, orientation):
        """The object's half sizes as a symmetric matrix along the world's axes."""
        turned, axes = np.empty(4), np.empty(9)
        mujoco.mju_mulQuat(turned, orientation / np.linalg.norm(orientation), self.principal_axes)
        mujoco.mju_quat2Mat(axes, turned)
        axes = axes.reshape(3, 3)
        matrix = axes @ np.diag(self.half_sizes) @ axes.T
        return {f"shape_{'xyz'[i]}{'xyz'[j]}": matrix[i, j] for i in range(3) for j in range(i, 3)}

    def fingertip(self, name, axis, origin):
        """One coordinate of a fingertip, which is a site or a body, seen from a point."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, name)
        place = self.data.site_xpos[site] if site >= 0 else self.data.xpos[self.id(mujoco.mjtObj.mjOBJ_BODY, name)]
        return (place - origin)["xyz".index(axis)]

    def observe(self):
        qpos, qvel = self.data.qpos, self.data.qvel
        place, speed = qpos[self.object_qpos :][:7], qvel[self.object_dof :][:6]
        known = dict(zip(("x", "y", "z", "qw", "qx", "qy", "qz"), place))
        known |= dict(zip(("vx", "vy", "vz", "wx", "wy", "wz"), speed), id=self.object_id)
        known |= self.shape(place[3:])

        def value(source):
            kind, name = source.split(":", 1)
            if kind == "object":
                return known[name]
            if kind == "fingertip":
                return self.fingertip(*name.rsplit(":", 1), place[:3])
            joint = self.id(mujoco.mjtObj.mjOBJ_JOINT, name)
            if kind == "qpos":
                return qpos[self.model.jnt_qposadr[joint]]
            return qvel[self.model.jnt_dofadr[joint]]

        return np.array([value(source) for source in self.sources], np.float32)

    def touching(self):
        """Returns the geoms that touch the object."""
        others = []
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            pair = {contact.geom1, contact.geom2}
            if contact.efc_address >= 0 and self.object_geom in pair:
                others += pair - {self.object_geom}
        return others

    def succeeds(self, goal):
        """Tells whether the object is near its goal and held: it touches the hand and not the plane."""
        others = self.touching()
        held = any(self.is_hand[g] for g in others) and self.plane_geom not in others
        place = self.data.qpos[self.object_qpos :][:3]
        return held and np.linalg.norm(place - goal) < self.config["success_distance_m"]

    def place(self, random):
        """Draws a start and a goal: the object as it rests in the reference, moved and turned about the vertical, and the
        hand closed by a share."""
        at, span = self.object_qpos, self.config["object_range_m"]
        place = self.start[at : at + 7].copy()
        place[:2] = random.uniform(-span, span, 2)
        half = random.uniform(-np.pi, np.pi) / 2
        mujoco.mju_mulQuat(place[3:], np.array([np.cos(half), 0, 0, np.sin(half)]), self.start[at + 3 : at + 7])
        goal = place[:3] + [0, 0, random.uniform(*self.config["goal_height_m"])]
        share = random.uniform(*self.config["start"]["closed_share"])
        while True:
            qpos, ctrl = self.close(share)
            qpos[at : at + 7] = place
            self.reset(qpos, ctrl)
            # A hand that would touch the object is closed less.
            closed = not np.array_equal(ctrl, self.config["start"]["ctrl"])
            if not closed or not any(self.is_hand[g] for g in self.touching()):
                return qpos, ctrl, goal
            share = share / 2 if share > 0.1 else 0.0


def check(scene, policy, reference):
    """Repeats the reference step and returns the largest differences."""
    goal = np.array(reference["desired_goal"], np.float32)
    scene.reset(reference["qpos"], reference["ctrl"])
    observation = scene.observe()
    action = policy.act(observation, goal)
    # The step is taken with the recorded action, so that the simulation is compared by itself.
    scene.step(reference["action"])
    found = {"observation": observation, "action": action, "next_observation": scene.observe()}
    return {name: float(np.max(np.abs(value - np.array(reference[name])))) for name, value in found.items()}


def play(scene, policy, qpos, ctrl, goal):
    """Plays an episode; it succeeds when its last steps all do."""
    scene.reset(qpos, ctrl)
    good = []
    for _ in range(scene.config["episode_steps"]):
        scene.step(policy.act(scene.observe(), goal))
        good.append(scene.succeeds(goal))
    return all(good[-scene.config["final_steps"] :])


def write_png(path, image):
    """Writes an RGB image, height x width x 3 bytes."""
    height, width, _ = image.shape
    rows = b"".join(b"\0" + row.tobytes() for row in image)

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    pathlib.Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + body)


def render(scene, path):
    if not hasattr(mujoco, "Renderer"):
        sys.exit(f"mujoco {mujoco.__version__} has no Renderer: a newer one is needed for --render")
    renderer = mujoco.Renderer(scene.model, 480, 640)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0, 0, 0.12), 0.6, 130, -15
    renderer.update_scene(scene.data, camera)
    write_png(path, renderer.render())


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("run", type=pathlib.Path, help="run directory, or an export of it")
    parser.add_argument("--numbers", type=int, metavar="K", help="command the hand with K numbers")
    parser.add_argument("--object", help="name of the object; all of the run's by default")
    parser.add_argument("--episodes", type=int, default=1, help="episodes with each object")
    parser.add_argument("--seed", type=int, default=0, help="seed of the starts")
    parser.add_argument("--render", metavar="FILE.png", help="picture of the last episode's end")
    options = parser.parse_args()

    policy, reference_policy = Policy(options.run), Policy(options.run)
    references = json.loads((options.run / "scenes" / "reference.json").read_text())
    known = [reference["object"] for reference in references]
    if options.object and options.object not in known:
        parser.error(f"unknown object {options.object}; the run has {', '.join(known)}")
    if options.numbers is not None:
        if not (options.run / "synergy").is_dir():
            parser.error(f"{options.run} has no control synergy, because its policy never succeeded")
        synergy = tomllib.loads((options.run / "synergy" / "synergy.toml").read_text())
        if not 0 <= options.numbers <= len(synergy["components"]):
            parser.error(f"--numbers goes from 0 to {len(synergy['components'])} for this run")
        policy.use_numbers(synergy, options.numbers)
    print(f"MuJoCo {mujoco.__version__}, hand {policy.config['hand']}")
    tolerance = TOLERANCE if mujoco.__version__ == RUN_VERSION else NEWER_TOLERANCE
    random, good, played, worst = np.random.default_rng(options.seed), 0, 0, 0.0
    for reference in references:
        if options.object not in (None, reference["object"]):
            continue
        scene = Scene(options.run, policy, reference)
        differences = check(scene, reference_policy, reference)
        worst = max(worst, *differences.values())
        print(f"{reference['object']}: largest difference", ", ".join(f"{n} {d:.1e}" for n, d in differences.items()))
        for episode in range(options.episodes):
            success = play(scene, policy, *scene.place(random))
            print(f"{reference['object']}: episode {episode}", "succeeded" if success else "failed")
            good, played = good + success, played + 1
    print(f"{good} of {played} episodes succeeded")
    if options.render:
        render(scene, options.render)
    if worst > tolerance:
        sys.exit(
            f"the reference step differs by {worst:.1e}, and {tolerance:.0e} is expected at most: "
            f"use MuJoCo {RUN_VERSION}, with which the run was made"
        )


if __name__ == "__main__":
    main()
