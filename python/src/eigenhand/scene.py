"""The grasp task in MuJoCo: a hand on a vertical slide above a plane, with one object.

It is the task of the run: the same starts, observations, steps and successes. Sizes and friction stay those of the scene,
however a run draws them. MuJoCo 2.2.2 is the version that runs are made with; newer ones differ a little where the hand
presses the object.
"""

import os
import pathlib
import sys

import mujoco
import numpy as np

from eigenhand.files import read_json

# The MuJoCo that runs are made with.
RUN_VERSION = "2.2.2"
# Largest difference of the reference step with it, and with a newer one. Newer ones round contacts differently, which
# shows where the hand presses the object (measured with 4.0).
TOLERANCE, NEWER_TOLERANCE = 1e-5, 1e-2
# What newer ones do by default and 2.2.2 does not: they find the contacts of curved shapes in another way.
NEWER_FEATURES = ("mjDSBL_NATIVECCD", "mjDSBL_MULTICCD")
# The names of an object's numbers in an observation: place, speed, and half sizes along the world's axes.
PLACE, SPEED = ("x", "y", "z", "qw", "qx", "qy", "qz"), ("vx", "vy", "vz", "wx", "wy", "wz")
SHAPE = [f"shape_{'xyz'[i]}{'xyz'[j]}" for i in range(3) for j in range(i, 3)]
# Distance in m by which the object is moved aside while the hand closes, or the object comes to rest.
AWAY = 0.8


def load_model(path):
    """Reads a scene, so that any version of MuJoCo simulates it as 2.2.2 does, as far as it can."""
    model = mujoco.MjModel.from_xml_path(str(path))
    for feature in NEWER_FEATURES:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, feature, 0))
    return model


def read_references(directory):
    """Reads the reference step of each object: the first step of an episode, as the run recorded it."""
    return read_json(pathlib.Path(directory) / "scenes" / "reference.json")


class Scene:
    """A hand with one object, as a policy sees it."""

    def __init__(self, directory, policy, reference):
        self.config, self.reference, self.object = policy.config, reference, reference["object"]
        self.task = self.config["object"]
        self.policy = policy
        self.model = load_model(pathlib.Path(directory) / "scenes" / f"{self.object}.xml")
        self.data = mujoco.MjData(self.model)
        self.start = np.array(reference["qpos"])
        names = self.config["scene"]
        joint = self.id(mujoco.mjtObj.mjOBJ_JOINT, names["object_joint"])
        self.object_qpos, self.object_dof = self.model.jnt_qposadr[joint], self.model.jnt_dofadr[joint]
        self.object_geom = self.id(mujoco.mjtObj.mjOBJ_GEOM, names["object_geom"])
        self.plane_geom = self.id(mujoco.mjtObj.mjOBJ_GEOM, names["plane_geom"])
        hand = self.id(mujoco.mjtObj.mjOBJ_BODY, names["hand_body"])
        self.is_hand = np.array([self._is_below(self.model.geom_bodyid[g], hand) for g in range(self.model.ngeom)])
        # The observation names its joints, so no order has to be known here. The id is the object's number.
        sources = policy.observation
        self.tips = []
        self.columns = np.array([self._column(source) for source in sources])
        self.tip_places = [self._tip(tip) for tip in self.tips]
        # A policy that was trained without the object's number does not observe it.
        self.object_id = dict(zip(sources, reference["observation"])).get("object:id", np.nan)
        self.turned, self.axes = np.empty(4), np.empty(9)
        body = self.model.geom_bodyid[self.object_geom]
        inertia, self.principal_axes = self.model.body_inertia[body], self.model.body_iquat[body]
        # Half sizes of the box that has the object's mass and inertia.
        self.half_sizes = np.sqrt(np.maximum(1.5 * (inertia.sum() - 2 * inertia) / self.model.body_mass[body], 0))

    def id(self, kind, name):
        """Returns the number of a named element of the model."""
        found = mujoco.mj_name2id(self.model, kind, name)
        if found < 0:
            raise ValueError(f"the scene of {self.object} has no {name}")
        return found

    def _is_below(self, body, root):
        while body != root and body != 0:
            body = self.model.body_parentid[body]
        return body == root

    def reset(self, qpos, ctrl):
        """Sets positions and controls; everything is at rest."""
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
        mujoco.mj_step(self.model, self.data, round(start["closing_time_s"] / self.model.opt.timestep))
        return self.data.qpos.copy(), ctrl

    def _depth(self, rotation):
        """How far the object reaches below its centre when it is turned."""
        model, geom = self.model, self.object_geom
        size, down = model.geom_size[geom], -rotation[2]
        match model.geom_type[geom]:
            case mujoco.mjtGeom.mjGEOM_SPHERE:
                return size[0]
            case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
                return np.linalg.norm(size * down)
            case mujoco.mjtGeom.mjGEOM_BOX:
                return np.sum(size * np.abs(down))
            case mujoco.mjtGeom.mjGEOM_CAPSULE:
                return size[0] + size[1] * abs(down[2])
            case mujoco.mjtGeom.mjGEOM_CYLINDER:
                return size[0] * np.hypot(down[0], down[1]) + size[1] * abs(down[2])
            case _:
                mesh = model.geom_dataid[geom]
                first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
                # MuJoCo moves a mesh to its centre of mass and turns it to its principal axes.
                turned = np.empty(9)
                mujoco.mju_quat2Mat(turned, model.geom_quat[geom])
                vertices = model.mesh_vert[first : first + count] @ turned.reshape(3, 3).T + model.geom_pos[geom]
                return np.max(vertices @ down)

    def rest(self, random):
        """Drops the object in a random orientation, and returns its height and orientation once it has come to rest."""
        if self.task["orientation"] == "yaw":
            half = random.uniform(-np.pi, np.pi) / 2
            quaternion = np.array([np.cos(half), 0, 0, np.sin(half)])
        else:
            quaternion = random.normal(size=4)
            quaternion /= np.linalg.norm(quaternion)
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, quaternion)
        qpos, at = self.start.copy(), self.object_qpos
        # The hand does not reach it there.
        qpos[at : at + 3] = AWAY, 0, self._depth(rotation.reshape(3, 3)) + self.task["drop_m"]
        qpos[at + 3 : at + 7] = quaternion
        self.reset(qpos, self.config["start"]["ctrl"])
        mujoco.mj_step(self.model, self.data, round(self.task["settle_time_s"] / self.model.opt.timestep))
        resting = self.data.qpos[at + 2 : at + 7].copy()
        # A quaternion and its negative are the same orientation; an episode starts with the one whose w is not negative.
        return resting[0], resting[1:] if resting[1] >= 0 else -resting[1:]

    def draw(self, random):
        """Draws the start and the goal of an episode => positions, controls, goal.

        The object comes to rest in a random orientation at a random place, and the hand is closed by a random share.
        """
        at, span = self.object_qpos, self.config["object_range_m"]
        height, quaternion = self.rest(random)
        place = np.array([*random.uniform(-span, span, 2), height, *quaternion])
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

    def step(self, action):
        """Applies an action for one control period."""
        self.data.ctrl[:] = self.policy.command(action)
        mujoco.mj_step(self.model, self.data, self.config["substeps"])

    def _column(self, source):
        """Returns where a number of the observation stands in positions, velocities, and what is computed beside them."""
        kind, name = source.split(":", 1)
        n_state = self.model.nq + self.model.nv
        if kind == "object":
            if name in PLACE:
                return self.object_qpos + PLACE.index(name)
            if name in SPEED:
                return self.model.nq + self.object_dof + SPEED.index(name)
            return n_state + ("id", *SHAPE).index(name)
        if kind == "fingertip":
            tip, axis = name.rsplit(":", 1)
            if tip not in self.tips:
                self.tips.append(tip)
            return n_state + 1 + len(SHAPE) + 3 * self.tips.index(tip) + "xyz".index(axis)
        joint = self.id(mujoco.mjtObj.mjOBJ_JOINT, name)
        return self.model.jnt_qposadr[joint] if kind == "qpos" else self.model.nq + self.model.jnt_dofadr[joint]

    def _tip(self, tip):
        """Returns where a fingertip's place stands in the simulation: an array's name, and an index. It is a site or a body."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, tip)
        return ("site_xpos", site) if site >= 0 else ("xpos", self.id(mujoco.mjtObj.mjOBJ_BODY, tip))

    def observe(self):
        """Returns the observation, a float32 array; `policy.toml` names each of its numbers."""
        place = self.data.qpos[self.object_qpos :][:7]
        # The object's half sizes as a symmetric matrix along the world's axes.
        mujoco.mju_mulQuat(self.turned, place[3:] / np.linalg.norm(place[3:]), self.principal_axes)
        mujoco.mju_quat2Mat(self.axes, self.turned)
        axes = self.axes.reshape(3, 3)
        shape = ((axes * self.half_sizes) @ axes.T)[np.triu_indices(3)]
        tips = [getattr(self.data, array)[i] - place[:3] for array, i in self.tip_places]
        return np.concatenate([self.data.qpos, self.data.qvel, [self.object_id], shape, *tips])[self.columns].astype(np.float32)

    @property
    def place(self):
        """The object's place: x, y and z in m."""
        return self.data.qpos[self.object_qpos :][:3].copy()

    def touching(self):
        """Returns the geoms that touch the object."""
        others = []
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            pair = {contact.geom1, contact.geom2}
            if contact.efc_address >= 0 and self.object_geom in pair:
                others += pair - {self.object_geom}
        return others

    def is_held(self):
        """Tells whether the object touches the hand and not the plane."""
        others = self.touching()
        return any(self.is_hand[g] for g in others) and self.plane_geom not in others

    def succeeds(self, goal):
        """Tells whether the object is near its goal and held."""
        return self.is_held() and np.linalg.norm(self.place - goal) < self.config["success_distance_m"]

    def play(self, policy, random, each_step=lambda: None):
        """Plays an episode, and tells whether it succeeds: whether all of its last steps do."""
        qpos, ctrl, goal = self.draw(random)
        self.reset(qpos, ctrl)
        good = []
        for _ in range(self.config["episode_steps"]):
            self.step(policy.act(self.observe(), goal))
            good.append(self.succeeds(goal))
            each_step()
        return all(good[-self.config["final_steps"] :])

    def check(self):
        """Repeats the reference step, and returns the largest differences of observation, action and next observation."""
        reference = self.reference
        self.reset(reference["qpos"], reference["ctrl"])
        observation = self.observe()
        action = self.policy.act(observation, np.array(reference["desired_goal"], np.float32))
        # The step is taken with the recorded action, so that the simulation is compared by itself.
        self.step(reference["action"])
        found = {"observation": observation, "action": action, "next_observation": self.observe()}
        return {name: float(np.max(np.abs(array - np.array(reference[name])))) for name, array in found.items()}


def open_viewer(scene):
    """Opens MuJoCo's viewer on a scene."""
    # Without a display, the viewer would end the whole process.
    if sys.platform == "linux" and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise RuntimeError("the viewer needs a display; without one, use render_mode=\"rgb_array\", or play --gif")
    from mujoco import viewer

    return viewer.launch_passive(scene.model, scene.data)


class Camera:
    """Pictures of a scene, as arrays of height x width x 3 bytes. It needs OpenGL, and a MuJoCo newer than 2.2.2."""

    def __init__(self, model, width=640, height=480):
        if not hasattr(mujoco, "Renderer"):
            raise RuntimeError(f"mujoco {mujoco.__version__} has no Renderer: a newer one is needed for pictures")
        try:
            self.renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # MuJoCo raises errors of its own, which older versions do not have.
            raise RuntimeError(f"there is no OpenGL for pictures ({error}); without a display, set MUJOCO_GL=egl or osmesa") from error
        self.camera = mujoco.MjvCamera()
        self.camera.lookat[:], self.camera.distance = (0, 0, 0.12), 0.6
        self.camera.azimuth, self.camera.elevation = 130, -15

    def picture(self, data):
        self.renderer.update_scene(data, self.camera)
        return self.renderer.render()

    def close(self):
        self.renderer.close()
