//! Pictures of a hand: above the table with each object, in a grasp, and in given postures.

use std::sync::Arc;

use eigenhand_hands::{FrameKind, Hand};
use eigenhand_mujoco::{Data, MuJoCo};
use eigenhand_sim::{GraspEnv, GraspTask, ObjectScene, Setting};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::{Camera, Picture, RenderError, bounding_corners, draw, drawn_geoms};

/// Seed of the objects' places.
const SEED: u64 = 20;

/// Pixels of one tile.
const TILE: [usize; 2] = [480, 400];
const COLUMNS: usize = 4;
/// Share of a tile that the hand and the object fill.
const FILLED: f64 = 0.88;
/// Looks at the hand from its side and a little from above, so that the gap between palm and object is visible.
const FROM_THE_SIDE: Camera =
    Camera { target: [0.0; 3], azimuth_deg: 215.0, elevation_deg: -16.0, distance: 1.0, fov_deg: 30.0 };
/// Looks at the palm through the table.
const FROM_BELOW: Camera = Camera { elevation_deg: 40.0, ..FROM_THE_SIDE };

/// Draws the open hand above the table at the start of an episode, one tile for each object of the setting. The last
/// tile shows the hand alone from below, without the table.
///
/// All tiles with an object share one camera, so that the objects' sizes can be compared. The camera frames the palm,
/// the fingers and the objects; an arm behind the palm may leave the picture.
///
/// # Errors
/// Those of [`GraspTask::new`] and [`GraspEnv::reset`].
pub fn hand_with_objects(hand: &Hand, library: &Arc<MuJoCo>, setting: &Setting) -> Result<Picture, RenderError> {
    let task = Arc::new(GraspTask::new(library, hand, setting)?);
    let mut env = GraspEnv::new(&task)?;
    env.start_open();
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut points = Vec::new();
    for (index, scene) in task.scenes.iter().enumerate() {
        env.reset(index, &mut random)?;
        let data = env.simulation();
        points.extend(hand_points(hand, scene, data)?);
        points.extend(bounding_corners(data, scene.object_geom()));
    }
    let [width, height] = TILE;
    let aspect = width as f64 / height as f64;
    let camera = FROM_THE_SIDE.framing(&points, aspect, FILLED);
    let mut tiles: Vec<Picture> = env.simulations().iter().map(|data| draw(data, &camera, width, height)).collect();
    if let Some(scene) = task.scenes.first() {
        let alone = task.open_hand(scene)?;
        let camera = FROM_BELOW.framing(&hand_points(hand, scene, &alone)?, aspect, FILLED);
        tiles.push(draw(&alone, &camera, width, height));
    }
    Ok(Picture::grid(&tiles, COLUMNS))
}

/// Draws the hand and its object in the state of a simulation, from the side.
///
/// # Errors
/// [`RenderError::MuJoCo`] for a palm or a fingertip that the model lacks.
pub fn grasp(hand: &Hand, scene: &ObjectScene, data: &Data) -> Result<Picture, RenderError> {
    let mut points = hand_points(hand, scene, data)?;
    points.extend(bounding_corners(data, scene.object_geom()));
    let [width, height] = TILE;
    let camera = FROM_THE_SIDE.framing(&points, width as f64 / height as f64, FILLED);
    Ok(draw(data, &camera, width, height))
}

/// Draws the hand alone in each posture. A row of postures gives a row of pictures; all pictures share one camera.
///
/// # Errors
/// As [`GraspTask::posed_hand`].
pub fn postures(hand: &Hand, task: &GraspTask, rows: &[Vec<Vec<f64>>]) -> Result<Picture, RenderError> {
    let Some(scene) = task.scenes.first() else { return Ok(Picture::grid(&[], 1)) };
    let posed: Vec<Data> =
        rows.iter().flatten().map(|posture| task.posed_hand(scene, posture)).collect::<Result<_, _>>()?;
    let mut points = Vec::new();
    for data in &posed {
        points.extend(hand_points(hand, scene, data)?);
    }
    let [width, height] = TILE;
    let camera = FROM_BELOW.framing(&points, width as f64 / height as f64, FILLED);
    let tiles: Vec<Picture> = posed.iter().map(|data| draw(data, &camera, width, height)).collect();
    Ok(Picture::grid(&tiles, rows.iter().map(Vec::len).max().unwrap_or(1)))
}

/// Returns the fingertips, and the corners of the bounding boxes of the geoms of the palm and its descendants.
fn hand_points(hand: &Hand, scene: &ObjectScene, data: &Data) -> Result<Vec<[f64; 3]>, RenderError> {
    let model = data.model();
    let below_palm = model.geoms_below(model.body(&hand.manifest.palm)?);
    let drawn = drawn_geoms(model);
    let corners = |belongs: &[bool]| -> Vec<[f64; 3]> {
        drawn.iter().filter(|geom| belongs[geom.index()]).flat_map(|&geom| bounding_corners(data, geom)).collect()
    };
    let mut points = corners(&below_palm);
    if points.is_empty() {
        points = corners(scene.is_hand());
    }
    for tip in &hand.fingertips {
        points.push(match tip.kind {
            FrameKind::Body => data.body_position(model.body(&tip.name)?).into(),
            FrameKind::Site => data.site_position(model.site(&tip.name)?).into(),
        });
    }
    Ok(points)
}
