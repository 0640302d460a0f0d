//! The simulator with real hands: scenes, determinism, threads, warnings and divergence.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::sync::Arc;

use eigenhand_hands::{FrameKind, Hand};
use eigenhand_mujoco::{Model, WarningCounts};
use eigenhand_rl::rng;
use eigenhand_sim::{GraspEnv, GraspTask, ObjectSet, Shape};
use eigenhand_synergy::Source;
use eigenhand_train::config::{Layers, Preset};
use eigenhand_train::{Behaviour, EvaluationStream, WorkerPool, evaluate, run_episode};
use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand::RngExt;

use crate::gripper::{GRIPPER_MANIFEST, GRIPPER_MODEL};
use crate::support::{
    constant_policy, gripper, gripper_with, gripper_with_full_contacts, job, mujoco, registry, task, tiny,
};

fn every_hand() -> Vec<Hand> {
    let registry = registry();
    let hands: Vec<Hand> = registry.list().iter().map(|e| e.hand.as_ref().unwrap().clone()).collect();
    assert!(!hands.is_empty());
    hands.into_iter().chain([gripper()]).collect()
}

/// Returns the task of a hand with every object, in the default configuration.
fn full_task(hand: &Hand) -> Arc<GraspTask> {
    let mut layers = Layers::new(Preset::Default).unwrap();
    layers.set("hand", hand.manifest.name.clone(), "test").unwrap();
    task(&layers.resolve().unwrap(), hand)
}

/// Returns the observations, facts and warnings of an episode with random actions.
fn random_episode(env: &mut GraspEnv, seed: u64, scene: usize, steps: usize) -> (Vec<u32>, WarningCounts) {
    let task = Arc::clone(env.task());
    let mut random = rng::stream(seed, "simulation", scene as u64);
    let mut observation = vec![0.0; task.observation_len()];
    let mut seen = Vec::new();
    env.reset(scene, &mut random).unwrap();
    for step in 0..=steps {
        env.observe(&mut observation);
        seen.extend(observation.iter().chain(&env.desired_goal()).map(|value| value.to_bits()));
        if step < steps {
            let action: Vec<f32> = (0..task.action_len()).map(|_| random.random_range(-1.0..=1.0)).collect();
            let facts = env.step(&action).unwrap();
            seen.extend(facts.to_array().map(f32::to_bits));
        }
    }
    (seen, env.warnings())
}

/// The model names its mesh folder twice, and `strippath` drops the folder in the file's name. The scene must read the
/// same file as the reader of the hand.
#[test]
fn a_scene_finds_the_files_that_the_hand_was_read_with() {
    let directory = tempfile::TempDir::new().unwrap();
    let write = |name: &str, text: &str| std::fs::write(directory.path().join(name), text).unwrap();
    let model = GRIPPER_MODEL
        .replace(
            "<default>",
            r#"<compiler meshdir="first"/><compiler meshdir="second" strippath="true"/>
            <asset><mesh name="pad" file="elsewhere/pad.obj"/></asset><default>"#,
        )
        .replace("<!-- extra bodies -->", r#"<geom type="mesh" mesh="pad" mass="0.01"/>"#);
    write("hand.toml", GRIPPER_MANIFEST);
    write("gripper.xml", &model);
    std::fs::create_dir(directory.path().join("second")).unwrap();
    write("second/pad.obj", "v 0 0 0\nv 0.01 0 0\nv 0 0.01 0\nv 0 0 0.01\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
    let hand = Hand::load(directory.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(task(&tiny(&[]), &hand).scenes.len(), 1);
}

#[test]
fn scenes_of_every_hand_compile_with_every_object() {
    for hand in every_hand() {
        let task = full_task(&hand);
        assert_eq!(task.scenes.len(), 7);
        let layout = task.observation_layout();
        assert_eq!(layout.len(), task.observation_len());
        let names: std::collections::BTreeSet<&str> = layout.iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(names.len(), layout.len(), "the names of the observation's entries must be unique");
        assert_eq!(task.action_len(), hand.actuators.len() + 1, "the slide has an actuator of its own");
        for scene in &task.scenes {
            // For every hand, the scene holds the hand's joints, the slide and a free object.
            assert_eq!(scene.model.nv(), hand.joints.len() + 1 + 6);
            assert_eq!(scene.model.nq(), hand.joints.len() + 1 + 7);
        }
    }
}

#[test]
fn the_shape_is_that_of_the_turned_object_and_the_same_for_its_symmetric_poses() {
    let task = full_task(&gripper());
    let shape = |name: &str, axis: Vector3<f64>, angle: f64| -> [f64; 6] {
        let scene = task.scenes.iter().find(|scene| scene.object.name == name).unwrap();
        let q = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), angle);
        scene.shape_along_axes([q.w, q.i, q.j, q.k])
    };
    let near = |what: &str, got: [f64; 6], expected: [f64; 6]| {
        let worst = got.iter().zip(expected).map(|(g, e)| (g - e).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "{what}: {got:?}, expected {expected:?}");
    };
    let scene = task.scenes.iter().find(|scene| scene.object.name == "box").unwrap();
    let Shape::Box { half: [x, y, z] } = scene.object.shape else { panic!("the object named box is not a box") };
    near("as it is", shape("box", Vector3::z(), 0.0), [x, y, z, 0.0, 0.0, 0.0]);
    near("a quarter about z", shape("box", Vector3::z(), FRAC_PI_2), [y, x, z, 0.0, 0.0, 0.0]);
    near("a quarter about x", shape("box", Vector3::x(), FRAC_PI_2), [x, z, y, 0.0, 0.0, 0.0]);
    let (mean, off) = ((x + y) / 2.0, (x - y) / 2.0);
    near("an eighth about z", shape("box", Vector3::z(), FRAC_PI_4), [mean, mean, z, off, 0.0, 0.0]);
    let somehow = Vector3::new(1.0, 2.0, 3.0);
    let half_turn = shape("box", Vector3::z(), FRAC_PI_4 + PI);
    near("a half turn more", half_turn, shape("box", Vector3::z(), FRAC_PI_4));
    near("a cube however turned", shape("cube", somehow, 0.7), shape("cube", Vector3::z(), 0.0));
    near("a cylinder turned about itself", shape("cylinder", Vector3::z(), 0.7), shape("cylinder", Vector3::z(), 0.0));
}

#[test]
fn the_observation_has_fingertips_and_shape_when_they_are_asked_for() {
    let hand = gripper();
    let with = full_task(&hand);
    let mut layers = Layers::new(Preset::Paper).unwrap();
    layers.set("hand", hand.manifest.name.clone(), "test").unwrap();
    let without = task(&layers.resolve().unwrap(), &hand);
    // Paper, section 3.1: angles and velocities of the joints, the object's pose, velocity and number.
    assert_eq!(without.observation_len(), 2 * without.posture_joints.len() + 14);
    assert_eq!(with.observation_len(), without.observation_len() + 6 + 3 * hand.fingertips.len());

    let mut env = GraspEnv::new(&with).unwrap();
    let setup = 4;
    env.reset(setup, &mut rng::stream(1, "simulation", 0)).unwrap();
    let mut observation = vec![0.0; with.observation_len()];
    env.observe(&mut observation);
    let at = |name: &str| with.observation_layout().iter().position(|entry| entry.name == name).unwrap();
    let orientation = ["qw", "qx", "qy", "qz"].map(|q| f64::from(observation[at(&format!("object:{q}"))]));
    let expected = with.scenes[4].shape_along_axes(orientation);
    for (name, expected) in ["xx", "yy", "zz", "xy", "xz", "yz"].into_iter().zip(expected) {
        let got = f64::from(observation[at(&format!("object:shape_{name}"))]);
        assert!((got - expected).abs() < 1e-6, "{name}: {got}, expected {expected}");
    }
    let data = env.simulation();
    for tip in &hand.fingertips {
        let place = match tip.kind {
            FrameKind::Body => data.body_position(data.model().body(&tip.name).unwrap()),
            FrameKind::Site => data.site_position(data.model().site(&tip.name).unwrap()),
        };
        for (axis, (place, object)) in ["x", "y", "z"].into_iter().zip(place.iter().zip(env.achieved_goal())) {
            let got = f64::from(observation[at(&format!("fingertip:{}:{axis}", tip.name))]);
            assert!((got - (place - f64::from(object))).abs() < 1e-6, "{}: {got}", tip.name);
        }
    }
}

#[test]
fn a_scene_that_is_written_out_compiles_to_the_same_model() {
    let library = mujoco();
    for hand in every_hand() {
        for scene in &full_task(&hand).scenes {
            let again = Model::from_xml(&library, &scene.scene.xml, &scene.scene.assets).unwrap();
            assert_eq!((again.nq(), again.nv(), again.nu()), (scene.model.nq(), scene.model.nv(), scene.model.nu()));
            assert_eq!(again.qpos0(), scene.model.qpos0());
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_observations_to_the_last_bit() {
    for hand in every_hand() {
        let task = full_task(&hand);
        let (mut one, mut other) = (GraspEnv::new(&task).unwrap(), GraspEnv::new(&task).unwrap());
        // Earlier episodes must leave no trace.
        random_episode(&mut other, 3, 1, 10);
        let first = random_episode(&mut one, 1, 1, 25);
        assert_eq!(first, random_episode(&mut other, 1, 1, 25));
        assert_eq!(first, random_episode(&mut one, 1, 1, 25));
        assert_ne!(first.0, random_episode(&mut one, 2, 1, 25).0);
    }
}

#[test]
fn threads_that_share_a_model_do_not_disturb_one_another() {
    let hand = registry().list()[0].hand.as_ref().unwrap().clone();
    let task = full_task(&hand);
    let alone: Vec<_> = (0..4)
        .map(|seed| {
            let mut env = GraspEnv::new(&task).unwrap();
            random_episode(&mut env, seed, 0, 25)
        })
        .collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4)
            .map(|seed| {
                let task = &task;
                scope.spawn(move || {
                    let mut env = GraspEnv::new(task).unwrap();
                    random_episode(&mut env, seed, 0, 25)
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(alone, together);
}

/// Returns the height in m to which a gripper lifts a ball.
fn lifted(friction: &str) -> f64 {
    let task = task(&tiny(&["objects=[\"sphere\"]", friction]), &gripper());
    let mut env = GraspEnv::new(&task).unwrap();
    env.reset(0, &mut rng::stream(1, "simulation", 0)).unwrap();
    let start = f64::from(env.achieved_goal()[2]);
    for (steps, action) in [(15, [-1.0, -1.0]), (15, [-1.0, 1.0]), (30, [1.0, 1.0])] {
        (0..steps).for_each(|_| _ = env.step(&action).unwrap());
    }
    f64::from(env.achieved_goal()[2]) - start
}

/// The gripper's own friction is 2, and MuJoCo takes the larger of two frictions of equal priority.
#[test]
fn a_ball_of_low_friction_slides_out_of_the_gripper() {
    let (sticky, slippery) = (lifted("physics.friction=[0.9, 0.9]"), lifted("physics.friction=[0.02, 0.02]"));
    assert!(sticky > 0.05, "lifted by {sticky} m");
    assert!(slippery < 0.005, "lifted by {slippery} m");
}

/// Between the pads of the gripper stands a post, which the pads hit when they close without an object.
#[test]
fn links_of_the_hand_collide_with_one_another_when_asked_to() {
    let post = r#"<body pos="0 0 -0.04"><joint name="post_joint" axis="0 0 1" range="0 0.001"/>
        <geom type="box" size="0.02 0.01 0.03" mass="0.05"/></body>"#;
    let [(through, none), (stopped, depth)] = [false, true].map(|on| {
        let task = task(&tiny(&[&format!("physics.self_collision={on}")]), &gripper_with(post, ""));
        assert_eq!(task.self_contacts.is_some(), on);
        let mut env = GraspEnv::new(&task).unwrap();
        env.reset(0, &mut rng::stream(1, "simulation", 0)).unwrap();
        (0..30).for_each(|_| _ = env.step(&[1.0, 1.0]).unwrap());
        let left = task.posture_joints.iter().position(|joint| joint.name == "left_joint").unwrap();
        let mut posture = vec![0.0; task.posture_joints.len()];
        env.posture(&mut posture);
        (posture[left], env.self_penetration())
    });
    // A pad touches the post when it has moved by 42 mm; without the post, it moves by 50 mm.
    assert!(through > 0.047 && none == 0.0, "moved by {through} m, {none} m deep");
    assert!(stopped < 0.044 && depth > 0.0 && depth < 0.002, "moved by {stopped} m, {depth} m deep");
}

#[test]
fn bodies_that_overlap_in_the_open_posture_do_not_collide() {
    let beside = |y: f64| {
        let body = format!(
            r#"<body name="beside" pos="0 {y} -0.04"><joint name="beside_joint" axis="0 0 1" range="0 0.001"/>
            <geom type="box" size="0.02 0.008 0.03" mass="0.05"/></body>"#
        );
        let task = task(&tiny(&["physics.self_collision=true"]), &gripper_with(&body, ""));
        task.self_contacts.as_ref().unwrap().overlaps().to_vec()
    };
    let [overlap] = beside(0.05).try_into().unwrap();
    assert_eq!(overlap.bodies, ["left", "beside"]);
    // Both pads are 16 mm thick, and their middles 10 mm apart. MuJoCo gives contacts of boxes part of that depth.
    assert!((0.002..0.0061).contains(&overlap.depth), "{overlap:?}");
    assert!(beside(0.0).is_empty());
}

#[test]
fn every_hand_is_free_of_contact_at_the_start_with_self_collision() {
    for hand in every_hand() {
        let mut layers = Layers::new(Preset::Default).unwrap();
        layers.set("hand", hand.manifest.name.clone(), "test").unwrap();
        layers.add_assignment("physics.self_collision=true").unwrap();
        layers.add_assignment("objects=[\"cube\"]").unwrap();
        let task = task(&layers.resolve().unwrap(), &hand);
        let mut env = GraspEnv::new(&task).unwrap();
        // The fingers of a closed hand may touch.
        env.start_open();
        env.reset(0, &mut rng::stream(1, "simulation", 0)).unwrap();
        assert_eq!(env.self_penetration(), 0.0, "{}", hand.manifest.name);
        let (_, warnings) = random_episode(&mut env, 5, 0, 50);
        assert!(warnings.is_clear(), "{}: {warnings:?}", hand.manifest.name);
        println!("{}: {:?}", hand.manifest.name, task.self_contacts.as_ref().unwrap().overlaps());
    }
}

/// Returns `qpos` after each step of an episode with random actions, and the observation after the reset.
fn trajectory(env: &mut GraspEnv, scene: usize, index: u64) -> (Vec<f64>, Vec<f32>) {
    let task = Arc::clone(env.task());
    let mut observation = vec![0.0; task.observation_len()];
    env.reset(scene, &mut rng::stream(1, "simulation", index)).unwrap();
    env.observe(&mut observation);
    let mut random = rng::stream(2, "simulation", index);
    let mut seen = env.simulation().qpos().to_vec();
    for _ in 0..10 {
        let action: Vec<f32> = (0..task.action_len()).map(|_| random.random_range(-1.0..=1.0)).collect();
        env.step(&action).unwrap();
        seen.extend_from_slice(env.simulation().qpos());
    }
    (seen, observation)
}

#[test]
fn an_object_of_drawn_size_and_friction_simulates_as_a_compiled_one() {
    let objects = "objects=[\"cube\", \"capsule\", \"ellipsoid\"]";
    let task_with = |scale: String, friction: String| task(&tiny(&[objects, &scale, &friction]), &gripper());
    let drawn = task_with("task.object_scale=[0.7, 1.1]".to_owned(), "physics.friction=[0.3, 1.2]".to_owned());
    let mut env = GraspEnv::new(&drawn).unwrap();
    let mut sizes = Vec::new();
    for index in 0..6 {
        let scene = index as usize % 3;
        let (seen, observation) = trajectory(&mut env, scene, index);
        let (scale, friction) = (env.object_scale(), env.friction());
        assert!((0.7..=1.1).contains(&scale) && (0.3..=1.2).contains(&friction), "{scale}, {friction}");
        sizes.push(scale);
        let fixed = task_with(
            format!("task.object_scale=[{scale}, {scale}]"),
            format!("physics.friction=[{friction}, {friction}]"),
        );
        let mut fixed = GraspEnv::new(&fixed).unwrap();
        let (expected, expected_observation) = trajectory(&mut fixed, scene, index);
        assert_eq!(seen.len(), expected.len());
        let worst = seen.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "episode {index}: the trajectories differ by {worst}");
        for (a, b) in observation.iter().zip(&expected_observation) {
            assert!((a - b).abs() < 1e-6, "episode {index}: observed {a}, expected {b}");
        }
        // Other episodes came before; a fresh environment plays the same one.
        assert_eq!(trajectory(&mut GraspEnv::new(&drawn).unwrap(), scene, index).0, seen);
    }
    sizes.dedup();
    assert_eq!(sizes.len(), 6);
}

/// The vertices of a mesh have single precision, so its trajectories are nearly the same.
#[test]
fn a_mesh_of_drawn_size_simulates_as_a_compiled_one() {
    let with = |scale: &str| task(&tiny(&["objects=[\"varied/cone\"]", scale]), &gripper());
    let drawn = with("task.object_scale=[0.7, 1.1]");
    let mut env = GraspEnv::new(&drawn).unwrap();
    let (seen, observation) = trajectory(&mut env, 0, 0);
    let scale = env.object_scale();
    let fixed = with(&format!("task.object_scale=[{scale}, {scale}]"));
    let (expected, expected_observation) = trajectory(&mut GraspEnv::new(&fixed).unwrap(), 0, 0);
    let worst = seen.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-4, "the trajectories differ by {worst}");
    assert!(observation.iter().zip(&expected_observation).all(|(a, b)| (a - b).abs() < 1e-5));
}

#[test]
fn every_object_of_every_set_comes_to_rest() {
    let sets: Vec<String> = ObjectSet::all().into_iter().map(|set| set.name).collect();
    let objects = format!("objects={sets:?}");
    let settings = [objects.as_str(), "task.orientation=any", "task.settle_time=1.0", "hand=shadow"];
    let task = task(&tiny(&settings), &registry().get("shadow").unwrap());
    let mut env = GraspEnv::new(&task).unwrap();
    for (index, scene) in task.scenes.iter().enumerate() {
        env.reset(index, &mut rng::stream(1, "simulation", index as u64)).unwrap();
        let height = f64::from(env.achieved_goal()[2]);
        let name = &scene.object.name;
        assert!(height > 0.004 && height < 0.07, "{name} rests with its centre {height} m above the plane");
        assert!(env.facts().touches_plane, "{name} is not on the plane");
        assert!(env.warnings().is_clear(), "{name}: {:?}", env.warnings());
    }
}

#[test]
fn an_object_that_a_policy_does_not_know_has_the_number_of_one_that_it_knows() {
    let with = |objects: &str| GraspTask::new(&mujoco(), &gripper(), &tiny(&[objects]).setting()).unwrap();
    let known = with("objects=[\"cube\", \"sphere\"]");
    let mut other = with("objects=[\"varied/ball-large\", \"sphere\", \"varied/die\"]");
    other.take_ids_from(&known);
    let ids: Vec<usize> = other.scenes.iter().map(|scene| scene.object.id).collect();
    assert_eq!(ids, [1, 0, 0]);
}

#[test]
fn the_number_of_the_object_can_be_left_out_of_the_observation() {
    let [with, without] = [true, false].map(|on| task(&tiny(&[&format!("task.observe_id={on}")]), &gripper()));
    let names = |task: &GraspTask| task.observation_layout().into_iter().map(|e| e.name).collect::<Vec<_>>();
    let mut expected = names(&with);
    expected.retain(|name| name != "object:id");
    assert_eq!((names(&without), without.observation_len()), (expected, with.observation_len() - 1));
    let mut env = GraspEnv::new(&without).unwrap();
    env.reset(0, &mut rng::stream(1, "simulation", 0)).unwrap();
    let mut observation = vec![f32::NAN; without.observation_len()];
    env.observe(&mut observation);
    assert!(observation.iter().all(|value| value.is_finite()));
}

#[test]
fn draws_change_neither_poses_nor_goals_of_an_episode() {
    let settings = ["task.object_scale=[0.999, 1.001]", "physics.friction=[0.9, 1.1]", "task.orientation=any"];
    let [drawn, fixed] = [&settings[..], &settings[2..]].map(|settings| task(&tiny(settings), &gripper()));
    let start = |task: &Arc<GraspTask>| {
        let mut env = GraspEnv::new(task).unwrap();
        env.reset(0, &mut rng::stream(1, "simulation", 0)).unwrap();
        env.desired_goal()
    };
    for (a, b) in start(&drawn).into_iter().zip(start(&fixed)) {
        assert!((a - b).abs() < 1e-3, "{a}, {b}");
    }
    let shadow = registry().get("shadow").unwrap();
    let [drawn_too, fixed_too] = [&settings[..], &settings[2..]].map(|settings| task(&tiny(settings), &shadow));
    let controls = |task: &Arc<GraspTask>| {
        let mut env = GraspEnv::new(task).unwrap();
        env.reset(0, &mut rng::stream(1, "simulation", 0)).unwrap();
        env.simulation().ctrl().to_vec()
    };
    assert_ne!(controls(&fixed_too), fixed_too.start_controls());
    assert_eq!(controls(&drawn_too), controls(&fixed_too), "the hand is closed by the same share");
    let mut middle = GraspEnv::without_draws(&drawn).unwrap();
    middle.reset(0, &mut rng::stream(1, "simulation", 0)).unwrap();
    assert_eq!((middle.object_scale(), middle.friction()), (1.0, 1.0));
}

/// Returns the start of an episode: `qpos` and `ctrl` of the simulation, and the goal.
fn start(task: &Arc<GraspTask>, index: u64) -> (Vec<f64>, Vec<f64>, [f32; 3]) {
    let mut env = GraspEnv::new(task).unwrap();
    env.reset(0, &mut rng::stream(1, "simulation", index)).unwrap();
    let data = env.simulation();
    (data.qpos().to_vec(), data.ctrl().to_vec(), env.desired_goal())
}

#[test]
fn the_hand_starts_closed_by_a_random_share() {
    let shadow = registry().get("shadow").unwrap();
    let with = |range: &str| task(&tiny(&["objects=[\"cube\"]", &format!("task.closed_start={range}")]), &shadow);
    let [open, any, closed] = ["[0.0, 0.0]", "[0.0, 1.0]", "[1.0, 1.0]"].map(with);
    let mut shares = Vec::new();
    for index in 0..6 {
        let [(open_qpos, open_ctrl, goal), (qpos, ctrl, same_goal), (closed_qpos, closed_ctrl, _)] =
            [&open, &any, &closed].map(|task| start(task, index));
        assert_eq!(open_ctrl, open.start_controls());
        assert_eq!(closed_ctrl, open.closed_controls());
        // The object and its goal do not depend on the hand. The object comes first.
        assert_eq!((&open_qpos[..7], goal), (&qpos[..7], same_goal));
        let share = |i: usize| (ctrl[i] - open_ctrl[i]) / (closed_ctrl[i] - open_ctrl[i]);
        let closing: Vec<usize> = (0..ctrl.len()).filter(|&i| closed_ctrl[i] != open_ctrl[i]).collect();
        assert_eq!(closing.len(), shadow.manifest.closing.len());
        assert!(closing.iter().all(|&i| (share(i) - share(closing[0])).abs() < 1e-12));
        shares.push(share(closing[0]));
        let joint = |qpos: &[f64]| qpos[7 + any.posture_joints.iter().position(|j| j.name == "FFJ1").unwrap()];
        let reached = (joint(&qpos) - joint(&open_qpos)) / (joint(&closed_qpos) - joint(&open_qpos));
        assert!((reached - share(closing[0])).abs() < 0.2, "{reached}, {}", share(closing[0]));
        assert!(joint(&closed_qpos) > 0.8, "the finger is bent: {}", joint(&closed_qpos));
    }
    shares.sort_by(f64::total_cmp);
    assert!(shares[0] >= 0.0 && shares[5] <= 1.0 && shares[5] - shares[0] > 0.3, "{shares:?}");
    assert_eq!(start(&any, 3), start(&any, 3));
}

#[test]
fn a_hand_that_would_touch_the_object_starts_more_open() {
    let parallel = registry().get("parallel").unwrap();
    let low = Hand {
        manifest: {
            let mut m = parallel.manifest.clone();
            m.slide.start = -0.08;
            m
        },
        ..parallel
    };
    let task = task(&tiny(&["objects=[\"cube\"]", "task.closed_start=[1.0, 1.0]"]), &low);
    let mut env = GraspEnv::new(&task).unwrap();
    let mut starts = Vec::new();
    for index in 0..4 {
        env.reset(0, &mut rng::stream(1, "simulation", index)).unwrap();
        assert!(!env.facts().touches_hand, "episode {index}");
        assert_ne!(env.simulation().ctrl(), task.closed_controls());
        starts.push(env.simulation().ctrl().to_vec());
    }
    assert!(starts.iter().any(|ctrl| ctrl != task.start_controls()), "not all the way: {starts:?}");
}

#[test]
fn an_episode_is_a_function_of_its_job() {
    let config = tiny(&[]);
    let task = task(&config, &gripper());
    let policy = constant_policy(&task, &vec![0.2; task.action_len()]);
    let behaviour = Behaviour::Explore(Arc::new(config.exploration.clone()));
    let jobs = || (0..12).map(|index| job(&policy, &behaviour, index));
    let mut results = [1, 3].map(|workers| {
        let mut pool = WorkerPool::new(&task, workers).unwrap();
        pool.submit(jobs()).unwrap();
        pool.collect().unwrap()
    });
    let [one, three] = &mut results;
    assert_eq!(one.len(), 12);
    for (a, b) in one.iter().zip(three) {
        assert_eq!((a.index, a.scene, a.success, a.source), (b.index, b.scene, b.success, b.source));
        assert_eq!(a.data, b.data);
        assert_eq!(a.posture, b.posture);
    }
    // Half of the episodes have no noise; twelve episodes contain both kinds.
    assert!(one.iter().any(|e| e.source == Source::Policy) && one.iter().any(|e| e.source == Source::Noise));
}

#[test]
fn a_full_contact_buffer_is_counted() {
    let task = task(&tiny(&["task.steps=3"]), &gripper_with_full_contacts());
    let mut env = GraspEnv::new(&task).unwrap();
    let policy = constant_policy(&task, &vec![0.0; task.action_len()]);
    let episode = run_episode(&mut env, &mut policy.scratch(), &job(&policy, &Behaviour::Greedy, 0)).unwrap();
    assert!(episode.warnings.contacts_full > 0, "{:?}", episode.warnings);
    let mut pool = WorkerPool::new(&task, 1).unwrap();
    let evaluation = evaluate(&mut pool, &task, &policy, 1, EvaluationStream::Final, 0..2).unwrap();
    assert!(evaluation.warnings.contacts_full >= 2, "{:?}", evaluation.warnings);
}

#[test]
fn a_sound_hand_raises_no_warning() {
    for hand in every_hand() {
        let task = full_task(&hand);
        let mut env = GraspEnv::new(&task).unwrap();
        let (_, warnings) = random_episode(&mut env, 5, 0, 50);
        assert!(warnings.is_clear(), "{}: {warnings:?}", hand.manifest.name);
    }
}

/// An equality couples two joints, or two tendons that are sums of joints: the joint without an actuator follows.
#[test]
fn coupled_joints_without_an_actuator_follow() {
    let joint = r#"<joint name="together" joint1="right_joint" joint2="left_joint" polycoef="0 1 0 0 0"/>"#;
    let tendon = r#"<tendon tendon1="difference"/></equality><tendon><fixed name="difference">
        <joint joint="right_joint" coef="1"/><joint joint="left_joint" coef="-1"/></fixed></tendon><equality>"#;
    assert!(GRIPPER_MODEL.contains(joint));
    for text in [GRIPPER_MODEL.to_owned(), GRIPPER_MODEL.replace(joint, tendon)] {
        let model = Model::from_xml(&mujoco(), &text, &[]).unwrap_or_else(|error| panic!("{error}"));
        let names: Vec<String> = model.following_joints().into_iter().map(|joint| model.joint_name(joint)).collect();
        assert_eq!(names, ["right_joint"]);
    }
}
