//! Pictures of a hand: above the table with each object, in a grasp, in given postures, and in an episode.

use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_mujoco::Data;
use eigenhand_sim::{GraspEnv, GraspTask, ObjectScene, fingertip_positions};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::{Camera, Picture, RenderError, bounding_corners, draw, drawn_geoms};

/// Seed of the objects' places.
const SEED: u64 = 20;

/// Pixels of one tile.
const TILE: [usize; 2] = [480, 400];
const ASPECT: f64 = TILE[0] as f64 / TILE[1] as f64;
/// Columns of the tiles of a hand.
pub const COLUMNS: usize = 4;
/// Time in s in which a hand closes.
const CLOSING: f64 = 0.8;
/// Share of a tile that the hand and the object fill.
const FILLED: f64 = 0.88;
/// Looks at the hand from its side and a little from above, so that the gap between palm and object is visible.
const FROM_THE_SIDE: Camera =
    Camera { target: [0.0; 3], azimuth_deg: 215.0, elevation_deg: -16.0, distance: 1.0, fov_deg: 30.0 };
/// Looks at the palm through the table.
const FROM_BELOW: Camera = Camera { elevation_deg: 40.0, ..FROM_THE_SIDE };
/// Looks from a quarter turn further on.
const FROM_ANOTHER_SIDE: Camera = Camera { azimuth_deg: 125.0, ..FROM_THE_SIDE };
/// Pixels of a frame of an episode.
const FRAME: [usize; 2] = [360, 300];

/// Draws the open hand above the table at the start of an episode, one tile for each object of the setting. Two more tiles
/// show the hand alone from below, without the table: open, with the names of its fingertips, and closed, if it has
/// actuators that close it. Each tile has a label.
///
/// All tiles with an object share one camera, so that the objects' sizes can be compared. The camera frames the palm,
/// the fingers and the objects; an arm behind the palm may leave the picture.
///
/// # Errors
/// Those of [`GraspTask::new`] and [`GraspEnv::reset`].
pub fn hand_with_objects(hand: &Hand, task: &Arc<GraspTask>) -> Result<Vec<Picture>, RenderError> {
    let mut env = GraspEnv::new(task)?;
    env.start_open();
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut points = Vec::new();
    for (index, scene) in task.scenes.iter().enumerate() {
        env.reset(index, &mut random)?;
        let data = env.simulation();
        points.extend(hand_points(hand, scene, data)?);
        points.extend(bounding_corners(data, scene.object_geom()));
    }
    let camera = FROM_THE_SIDE.framing(&points, ASPECT, FILLED);
    let above = |(data, scene): (&Data, &ObjectScene)| tile(data, &camera).labelled(&scene.object.name);
    let mut tiles: Vec<Picture> = env.simulations().iter().zip(&task.scenes).map(above).collect();
    if let Some(scene) = task.scenes.first() {
        let mut alone = task.open_hand(scene)?;
        let camera = FROM_BELOW.framing(&hand_points(hand, scene, &alone)?, ASPECT, FILLED);
        let mut open = tile(&alone, &camera);
        for (tip, at) in hand.fingertips.iter().zip(fingertip_positions(hand, &alone)?) {
            if let Some([column, row]) = camera.pixel(at.into(), TILE) {
                open.write(&tip.name, [column as f32, row as f32]);
            }
        }
        tiles.push(open.labelled("open, as an object sees it"));
        if close(task, &mut alone) {
            tiles.push(tile(&alone, &camera).labelled("closed"));
        }
    }
    Ok(tiles)
}

fn tile(data: &Data, camera: &Camera) -> Picture {
    draw(data, camera, TILE[0], TILE[1])
}

/// Closes an open hand in free air, with the slide at its top. Returns false for a hand that has no actuators that do.
fn close(task: &GraspTask, data: &mut Data) -> bool {
    let change: Vec<f64> = task.closed_controls().iter().zip(task.start_controls()).map(|(c, o)| c - o).collect();
    // The slide stays where it is.
    data.ctrl_mut().iter_mut().zip(&change).for_each(|(ctrl, change)| *ctrl += change);
    for _ in 0..(CLOSING / data.model().timestep()).round() as usize {
        data.step();
    }
    change.iter().any(|&change| change != 0.0)
}

/// Draws the hand and its object in the state of a simulation, from two sides.
///
/// # Errors
/// [`RenderError::MuJoCo`] for a palm or a fingertip that the model lacks.
pub fn grasp(hand: &Hand, scene: &ObjectScene, data: &Data) -> Result<[Picture; 2], RenderError> {
    let points = grasp_points(hand, scene, data)?;
    Ok([FROM_THE_SIDE, FROM_ANOTHER_SIDE].map(|camera| tile(data, &camera.framing(&points, ASPECT, FILLED))))
}

fn grasp_points(hand: &Hand, scene: &ObjectScene, data: &Data) -> Result<Vec<[f64; 3]>, RenderError> {
    let mut points = hand_points(hand, scene, data)?;
    points.extend(bounding_corners(data, scene.object_geom()));
    Ok(points)
}

/// The camera of an episode: it stands still, and sees all that is shown to it beforehand.
#[derive(Default)]
pub struct Film {
    points: Vec<[f64; 3]>,
}

impl Film {
    /// Makes sure that the hand and its object will be in the picture where they are now.
    ///
    /// # Errors
    /// As [`grasp`].
    pub fn include(&mut self, hand: &Hand, scene: &ObjectScene, data: &Data) -> Result<(), RenderError> {
        self.points.extend(grasp_points(hand, scene, data)?);
        Ok(())
    }

    /// Draws a frame.
    pub fn frame(&self, data: &Data) -> Picture {
        draw(data, &FROM_THE_SIDE.framing(&self.points, FRAME[0] as f64 / FRAME[1] as f64, FILLED), FRAME[0], FRAME[1])
    }
}

/// Where a picture of a hand alone is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// From below, through the table: the palm.
    Palm,
    /// From the side, a little from above.
    Side,
}

/// Draws the hand alone in each posture, one picture for each. All share one camera.
///
/// # Errors
/// As [`GraspTask::posed_hand`].
pub fn postures(hand: &Hand, task: &GraspTask, postures: &[Vec<f64>], view: View) -> Result<Vec<Picture>, RenderError> {
    let Some(scene) = task.scenes.first() else { return Ok(Vec::new()) };
    let posed: Vec<Data> = postures.iter().map(|posture| task.posed_hand(scene, posture)).collect::<Result<_, _>>()?;
    let mut points = Vec::new();
    for data in &posed {
        points.extend(hand_points(hand, scene, data)?);
    }
    let from = match view {
        View::Palm => FROM_BELOW,
        View::Side => FROM_THE_SIDE,
    };
    let camera = from.framing(&points, ASPECT, FILLED);
    Ok(posed.iter().map(|data| tile(data, &camera)).collect())
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
    points.extend(fingertip_positions(hand, data)?.into_iter().map(<[f64; 3]>::from));
    Ok(points)
}
