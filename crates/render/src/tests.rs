use std::sync::Arc;

use eigenhand_mujoco::{Data, Model, MuJoCo};
use nalgebra::Vector3;

use super::*;
use crate::canvas::BACKGROUND;

/// Looks along y from far off, so that a metre has the same length everywhere: [`PER_METRE`] pixels.
const AFAR: Camera =
    Camera { target: [0.0; 3], azimuth_deg: 90.0, elevation_deg: 0.0, distance: 100.0, fov_deg: 0.572_957_8 };
const SIZE: usize = 200;
const PER_METRE: f64 = 200.0;
const HALF: usize = SIZE / 2;

fn simulation(assets: &str, world: &str) -> Data {
    let library = MuJoCo::load().unwrap_or_else(|error| panic!("{error}"));
    let xml = format!("<mujoco><asset>{assets}</asset><worldbody>{world}</worldbody></mujoco>");
    let model = Model::from_xml(&library, &xml, &[]).unwrap_or_else(|error| panic!("{error}"));
    let mut data = Data::new(&Arc::new(model)).unwrap();
    data.forward();
    data
}

fn picture(world: &str, camera: &Camera) -> Picture {
    draw(&simulation("", world), camera, SIZE, SIZE)
}

fn background() -> [u8; 3] {
    BACKGROUND.map(|channel| (255.0 * channel).round() as u8)
}

/// Returns the first and last column, and the first and last row, that are not all background.
fn silhouette(picture: &Picture) -> [usize; 4] {
    let painted = |column: usize, row: usize| picture.pixel(column, row) != Some(background());
    let all = (0..picture.width * picture.height).map(|i| (i % picture.width, i / picture.width));
    all.filter(|&(column, row)| painted(column, row)).fold([usize::MAX, 0, usize::MAX, 0], |found, (column, row)| {
        [found[0].min(column), found[1].max(column), found[2].min(row), found[3].max(row)]
    })
}

/// Asserts that the drawing extends from `low` to `high`, x and z in m.
fn assert_extent(data: &Data, low: [f64; 2], high: [f64; 2], what: &str) {
    let found = silhouette(&draw(data, &AFAR, SIZE, SIZE));
    let middle = HALF as f64;
    let expected = [
        middle + PER_METRE * low[0],
        middle + PER_METRE * high[0] - 1.0,
        middle - PER_METRE * high[1],
        middle - PER_METRE * low[1] - 1.0,
    ];
    for (found, expected) in found.iter().zip(expected) {
        assert!((*found as f64 - expected).abs() <= 2.0, "{what}: {found} instead of {expected}");
    }
}

/// Asserts that a pixel has the hue of a colour, however bright.
fn assert_hue(pixel: Option<[u8; 3]>, colour: [f64; 3]) {
    let pixel = Vector3::from(pixel.unwrap().map(f64::from));
    let angle = pixel.angle(&Vector3::from(colour));
    assert!(angle < 0.02 && pixel.norm() > 30.0, "{pixel:?} is not of colour {colour:?}");
}

#[test]
fn each_shape_is_drawn_where_it_is_and_as_large() {
    for (shape, half) in [
        (r#"type="sphere" size="0.2""#, [0.2, 0.2]),
        (r#"type="ellipsoid" size="0.1 0.2 0.3""#, [0.1, 0.3]),
        (r#"type="capsule" size="0.1 0.2""#, [0.1, 0.3]),
        (r#"type="capsule" size="0.1 0.2" euler="0 90 0""#, [0.3, 0.1]),
        (r#"type="capsule" size="0.1 0.2" euler="90 0 0""#, [0.1, 0.1]),
        (r#"type="cylinder" size="0.2 0.1""#, [0.2, 0.1]),
        (r#"type="cylinder" size="0.2 0.1" euler="0 90 0""#, [0.1, 0.2]),
        (r#"type="cylinder" size="0.2 0.1" euler="90 0 0""#, [0.2, 0.2]),
        (r#"type="box" size="0.3 0.1 0.2""#, [0.3, 0.2]),
        (r#"type="box" size="0.3 0.1 0.2" euler="0 0 90""#, [0.1, 0.2]),
    ] {
        let data = simulation("", &format!(r#"<geom {shape} pos="0.05 0 -0.1"/>"#));
        let [x, z] = [0.05, -0.1];
        assert_extent(&data, [x - half[0], z - half[1]], [x + half[0], z + half[1]], shape);
    }
}

#[test]
fn a_mesh_is_drawn_where_its_vertices_are() {
    // MuJoCo moves a mesh to its centre and principal axes; the picture must not show it.
    let mesh = r#"<mesh name="wedge" vertex="0 0 0  0.4 0 0  0 0.1 0  0 0 0.3  0.1 0.1 0.1"/>"#;
    let data = simulation(mesh, r#"<geom type="mesh" mesh="wedge" pos="-0.2 0 -0.1"/>"#);
    assert_extent(&data, [-0.2, -0.1], [0.2, 0.2], "mesh");
}

#[test]
fn a_sphere_above_a_plane_has_its_colour_where_it_is() {
    let camera = Camera { target: [0.0; 3], azimuth_deg: 120.0, elevation_deg: -30.0, distance: 2.0, fov_deg: 45.0 };
    let colour = [0.8, 0.2, 0.1];
    let place = Vector3::new(0.2, -0.1, 0.3);
    let world = r#"<geom type="plane" size="3 3 1" rgba="0.5 0.5 0.6 1"/>
                   <geom type="sphere" size="0.1" pos="0.2 -0.1 0.3" rgba="0.8 0.2 0.1 1"/>"#;
    let picture = picture(world, &camera);
    let seen = camera.axes() * (place - camera.position());
    let half = HALF as f64;
    let focal = half / 22.5f64.to_radians().tan();
    let [column, row] = [half + focal * seen.x / seen.z, half - focal * seen.y / seen.z].map(|x| x as usize);
    assert_hue(picture.pixel(column, row), colour);
    assert_hue(picture.pixel(5, SIZE - 5), [0.5, 0.5, 0.6]);
}

#[test]
fn what_is_nearer_hides_what_is_behind_in_either_order() {
    let near = r#"<geom type="box" size="0.1 0.1 0.1" pos="0 -0.5 0" rgba="0 1 0 1"/>"#;
    let far = r#"<geom type="box" size="0.3 0.1 0.3" rgba="1 0 0 1"/>"#;
    for world in [format!("{near}{far}"), format!("{far}{near}")] {
        let picture = picture(&world, &AFAR);
        assert_hue(picture.pixel(HALF, HALF), [0.0, 1.0, 0.0]);
        assert_hue(picture.pixel(HALF + 40, HALF), [1.0, 0.0, 0.0]);
    }
}

#[test]
fn what_no_viewer_shows_is_not_drawn() {
    let empty = picture("", &AFAR);
    assert_eq!(picture(r#"<geom type="sphere" size="0.2" rgba="1 0 0 0"/>"#, &AFAR), empty);
    let hull = r#"<geom type="box" size="0.3 0.3 0.3" group="3"/>"#;
    let front = r#"<geom type="sphere" size="0.1" group="2"/>"#;
    assert_eq!(
        picture(&format!("<body>{hull}{front}</body>"), &AFAR),
        picture(&format!("<body>{front}</body>"), &AFAR)
    );
    // A body without other geoms is drawn all the same.
    assert_ne!(picture(&format!("<body>{hull}</body>"), &AFAR), empty);
}

#[test]
fn a_material_colours_a_geom_that_states_no_colour() {
    let material = r#"<material name="m" rgba="0.2 0.4 0.8 1"/>"#;
    let geom = r#"<geom type="sphere" size="0.2" material="m"/>"#;
    let picture = draw(&simulation(material, geom), &AFAR, SIZE, SIZE);
    assert_hue(picture.pixel(HALF, HALF), [0.2, 0.4, 0.8]);
}

#[test]
fn a_shadow_tells_how_high_something_is() {
    let camera = Camera { target: [0.0; 3], azimuth_deg: 90.0, elevation_deg: -20.0, distance: 2.0, fov_deg: 45.0 };
    let brightness = |height: f64| {
        let world = format!(
            r#"<geom type="plane" size="0 0 1"/><geom type="sphere" size="0.05" pos="0 0 {}"/>"#,
            height + 0.05
        );
        // The middle of the picture is the plane below the sphere.
        picture(&world, &camera).pixel(HALF, HALF).unwrap()[1]
    };
    let heights = [0.15, 0.3, 0.45].map(brightness);
    assert!(heights[0] + 10 < heights[1] && heights[1] + 3 < heights[2], "{heights:?}");
}

#[test]
fn a_box_around_the_camera_fills_the_picture() {
    let inside = Camera { distance: 0.1, fov_deg: 60.0, azimuth_deg: 30.0, elevation_deg: -50.0, ..AFAR };
    let picture = picture(r#"<geom type="box" size="1 1 1" rgba="0 0 1 1"/>"#, &inside);
    assert!(picture.rgb.chunks_exact(3).all(|pixel| pixel[0] == 0 && pixel[2] > 0), "a gap in a box seen from inside");
}

#[test]
fn a_plane_is_not_seen_from_below() {
    let below = Camera { elevation_deg: 30.0, distance: 1.0, fov_deg: 40.0, ..AFAR };
    assert_eq!(picture(r#"<geom type="plane" size="0 0 1"/>"#, &below), picture("", &below));
}

#[test]
fn one_state_gives_one_picture() {
    let world = r#"<geom type="plane" size="1 1 1"/><geom type="ellipsoid" size="0.1 0.2 0.3" pos="0 0 0.4"/>"#;
    let camera = Camera { elevation_deg: -25.0, distance: 2.0, fov_deg: 40.0, ..AFAR };
    let first = picture(world, &camera);
    assert_eq!(first, picture(world, &camera));
    let file = first.png().unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(&file)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((info.width as usize, info.height as usize, pixels), (SIZE, SIZE, first.rgb));
}

#[test]
fn a_frame_holds_all_points_and_no_more() {
    let points: Vec<[f64; 3]> =
        (0..8).map(|i| [f64::from(i & 1) * 0.3, f64::from(i >> 1 & 1) * 0.1 - 2.0, f64::from(i >> 2) * 0.2]).collect();
    let camera = Camera { azimuth_deg: 215.0, elevation_deg: -20.0, fov_deg: 30.0, ..AFAR };
    let framed = camera.framing(&points, 1.5, 0.9);
    let half = framed.half_view(1.5);
    let reach = points.iter().map(|&point| {
        let seen = framed.axes() * (Vector3::from(point) - framed.position());
        (seen.x.abs() / seen.z / half[0]).max(seen.y.abs() / seen.z / half[1])
    });
    assert!((reach.fold(0.0, f64::max) - 0.9).abs() < 1e-9);
    assert_eq!(camera.framing(&[[f64::NAN; 3]], 1.5, 0.9), camera);
}

#[test]
fn pictures_are_put_in_rows() {
    let tile = |value: u8, width: usize| Picture { width, height: 2, rgb: vec![value; 3 * 2 * width] };
    let grid = Picture::grid(&[tile(1, 3), tile(2, 2), tile(3, 3)], 2);
    assert_eq!((grid.width, grid.height), (10, 8));
    assert_eq!(
        [(0, 0), (7, 1), (2, 7), (3, 0), (9, 0), (9, 7)].map(|(x, y)| grid.pixel(x, y).unwrap()[0]),
        [1, 2, 3, 255, 255, 255]
    );
    assert_eq!(grid.pixel(10, 0), None);
    let row = Picture::beside(&[tile(1, 3), tile(2, 2)]);
    assert_eq!((row.width, row.height), (10, 2));
    assert!(Picture::beside(&[]).png().is_err());
}

#[test]
fn a_label_is_in_the_lower_left_corner_and_keeps_within_the_picture() {
    let blank = Picture { width: 120, height: 60, rgb: vec![255; 3 * 120 * 60] };
    let inked = |picture: &Picture| -> Vec<[usize; 2]> {
        let at = |i: usize| [i % picture.width, i / picture.width];
        picture.rgb.chunks_exact(3).enumerate().filter(|(_, rgb)| rgb[0] < 128).map(|(i, _)| at(i)).collect()
    };
    let label = inked(&blank.clone().labelled("cube"));
    assert!(label.len() > 40 && label.iter().all(|[column, row]| *column < 60 && *row > 30), "{label:?}");
    // A text that begins near the right edge is moved to the left; one outside is left out.
    let mut moved = blank.clone();
    moved.write("thumb", [110.0, 30.0]);
    assert!(inked(&moved).len() > 40);
    let mut outside = blank.clone();
    outside.write("thumb", [0.0, -50.0]);
    assert_eq!(outside, blank);
}

#[test]
fn a_point_appears_at_its_pixel() {
    let camera = Camera { target: [0.0; 3], azimuth_deg: 90.0, elevation_deg: 0.0, distance: 1.0, fov_deg: 90.0 };
    let near = |got: Option<[f64; 2]>, want: [f64; 2]| {
        got.is_some_and(|got| got.iter().zip(want).all(|(g, w)| (g - w).abs() < 1e-9))
    };
    assert!(near(camera.pixel([0.0; 3], [200, 100]), [100.0, 50.0]));
    // Looking along y, x is to the right and z is up.
    assert!(near(camera.pixel([0.5, 0.0, 0.0], [200, 100]), [125.0, 50.0]));
    assert!(near(camera.pixel([0.0, 0.0, 0.5], [200, 100]), [100.0, 25.0]));
    assert_eq!(camera.pixel([0.0, -2.0, 0.0], [200, 100]), None);
}

#[test]
fn a_moving_picture_has_its_frames_and_their_times() {
    let frame = |colour: u8| Picture { width: 30, height: 20, rgb: vec![colour; 3 * 30 * 20] };
    let file = Picture::gif(&[(frame(10), 0.12), (frame(200), 1.5)]).unwrap();
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(file.as_slice()).unwrap();
    let mut found = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        found.push((frame.width, frame.height, frame.delay, frame.buffer[0]));
    }
    assert_eq!(found, [(30, 20, 12, 10), (30, 20, 150, 200)]);
    assert!(matches!(decoder.repeat(), gif::Repeat::Infinite));
    let smaller = Picture { width: 20, height: 20, rgb: vec![0; 3 * 20 * 20] };
    assert!(Picture::gif(&[(frame(10), 0.1), (smaller, 0.1)]).is_err());
    assert!(Picture::gif(&[]).is_err());
}
