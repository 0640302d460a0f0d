//! Composition of a scene: a hand on a vertical slide above a plane, and one object on the plane.
//!
//! The scene is built as an XML tree. The hand's defaults go into a class of their own, so that they apply to the hand
//! alone. Every element that is added here states all attributes that it needs.

use std::path::Path;

use eigenhand_files::read_regular;
use eigenhand_hands::xml::{append, attribute, element, elements, elements_mut, numbers, print, set};
use eigenhand_hands::xmltree::{Element, XMLNode};
use eigenhand_hands::{Hand, LARGEST_FILE};

use crate::SimError;
use crate::objects::{Object, Shape};
use crate::physics::{Cone, PhysicsConfig};
use crate::self_contacts::SelfContacts;
use crate::setting::middle;

/// Name of the plane's geom.
pub const PLANE: &str = "scene/plane";
/// Name of the object's body.
pub const OBJECT: &str = "scene/object";
/// Name of the object's free joint.
pub const OBJECT_JOINT: &str = "scene/object_joint";
/// Name of the object's geom.
pub const OBJECT_GEOM: &str = "scene/object_geom";
/// Name of the object's mesh, if it is one.
const OBJECT_MESH: &str = "scene/object_mesh";
/// Name of the body that the slide moves and that carries the hand.
pub const MOUNT: &str = "scene/mount";

/// Priority of the object's geom. MuJoCo takes friction and contact parameters of a pair from the geom of higher
/// priority; without this, it takes the larger friction of the two.
const OBJECT_PRIORITY: i32 = 1000;
const HAND_CLASS: &str = "scene/hand";
/// Mass in kg and inertia in kg m2 of the slide's carriage, small compared with any hand.
const CARRIAGE_MASS: f64 = 0.05;
const CARRIAGE_INERTIA: f64 = 1e-4;
const STANDARD_GRAVITY: f64 = 9.81;

/// Top-level sections of a hand's file that describe the hand. Other sections (options, size, keyframes, visual
/// settings, sensors) are not copied; the scene has its own where it needs them.
const HAND_SECTIONS: [&str; 5] = ["equality", "tendon", "actuator", "contact", "asset"];
const CLASSED_SECTIONS: [&str; 4] = ["equality", "tendon", "actuator", "contact"];
const CLASSLESS_ELEMENTS: [&str; 1] = ["exclude"];

/// A scene, ready to be compiled or written to a file.
#[derive(Clone, Debug)]
pub struct Scene {
    /// MJCF text that loads in MuJoCo 2.2.2 and newer.
    pub xml: String,
    /// The files (meshes, textures) that the text names, each with that name.
    pub assets: Vec<(String, Vec<u8>)>,
}

impl Scene {
    /// Composes the scene of `hand` and `object`.
    ///
    /// `lifted_mass` in kg is the mass that the slide's servo carries, which is the hand's. The servo balances its
    /// weight, and the limits on the speed of the slide depend on it. It is known once a scene has been compiled. With
    /// `self_contacts`, the links of the hand collide with one another.
    ///
    /// # Errors
    /// [`SimError::Hand`] when the hand's file has no body, [`SimError::ReadAsset`] for a file it names.
    pub fn compose(
        hand: &Hand,
        object: &Object,
        physics: &PhysicsConfig,
        lifted_mass: f64,
        self_contacts: Option<&SelfContacts>,
    ) -> Result<Scene, SimError> {
        let model = &hand.model;
        let mut root = element("mujoco", &[("model", format!("{}-{}", hand.manifest.name, object.name))]);
        append(&mut root, compiler(model));
        append(&mut root, hand_option(model, physics));
        append(&mut root, size(model, physics));
        append(&mut root, visual());
        append(&mut root, defaults(model));

        let mut world = Element::new("worldbody");
        append(&mut world, light());
        append(&mut world, plane());
        append(&mut world, object_body(object, physics));
        let mut carriage = mount(hand)?;
        if let Some(contacts) = self_contacts {
            contacts.apply(&mut carriage, hand)?;
        }
        append(&mut world, carriage);
        append(&mut root, world);

        let mut assets = Vec::new();
        for name in HAND_SECTIONS {
            let mut section = Element::new(name);
            if name == "actuator" {
                append(&mut section, slide_servo(hand, lifted_mass));
            }
            for own in elements(model).filter(|section| section.name == name) {
                section.children.extend(own.children.iter().filter(|c| c.as_element().is_some()).cloned());
            }
            if CLASSED_SECTIONS.contains(&name) {
                for item in elements_mut(&mut section) {
                    if item.attributes.get("name") != Some(&hand.manifest.slide.name)
                        && !CLASSLESS_ELEMENTS.contains(&item.name.as_str())
                    {
                        item.attributes.entry("class".to_owned()).or_insert_with(|| HAND_CLASS.to_owned());
                    }
                }
            }
            if let Some(contacts) = self_contacts.filter(|_| name == "contact") {
                contacts.exclude(&mut section);
            }
            if name == "asset" {
                collect_files(&mut section, hand, &mut assets)?;
                if let Some((item, file)) = object_mesh(object) {
                    append(&mut section, item);
                    assets.push(file);
                }
            }
            if !section.children.is_empty() {
                append(&mut root, section);
            }
        }
        Ok(Scene { xml: print(&root), assets })
    }
}

/// Returns the scene of the object alone on the plane; there it comes to rest before an episode.
pub(crate) fn resting_scene(object: &Object, physics: &PhysicsConfig) -> Scene {
    let mut root = element("mujoco", &[("model", object.name.clone())]);
    append(&mut root, option(physics));
    let mut assets = Vec::new();
    if let Some((item, file)) = object_mesh(object) {
        let mut section = Element::new("asset");
        append(&mut section, item);
        append(&mut root, section);
        assets.push(file);
    }
    let mut world = Element::new("worldbody");
    append(&mut world, plane());
    append(&mut world, object_body(object, physics));
    append(&mut root, world);
    Scene { xml: print(&root), assets }
}

/// Returns the asset of an object that is a mesh, and its file.
fn object_mesh(object: &Object) -> Option<(Element, (String, Vec<u8>))> {
    let Shape::Mesh(mesh) = &object.shape else { return None };
    let file = format!("object_{}.obj", object.name);
    let item = element("mesh", &[("name", OBJECT_MESH.into()), ("file", file.clone())]);
    Some((item, (file, mesh.to_obj().into_bytes())))
}

/// Keeps the hand's conventions for angles and frames. Directories are left out, because file names are resolved here.
/// Missing inertias are inferred, because the object states none.
fn compiler(model: &Element) -> Element {
    let mut compiler = Element::new("compiler");
    for own in elements(model).filter(|section| section.name == "compiler") {
        compiler.attributes.extend(own.attributes.iter().map(|(key, value)| (key.clone(), value.clone())));
    }
    for resolved in ["meshdir", "texturedir", "assetdir", "strippath"] {
        compiler.attributes.shift_remove(resolved);
    }
    if attribute(&compiler, "inertiafromgeom") == Some("false") {
        set(&mut compiler, "inertiafromgeom", "auto");
    }
    compiler
}

fn option(physics: &PhysicsConfig) -> Element {
    let cone = match physics.cone {
        Cone::Pyramidal => "pyramidal",
        Cone::Elliptic => "elliptic",
    };
    element(
        "option",
        &[
            ("timestep", physics.timestep.to_string()),
            ("gravity", numbers(&[0.0, 0.0, -STANDARD_GRAVITY])),
            ("cone", cone.to_owned()),
            ("impratio", physics.impratio.to_string()),
            ("noslip_iterations", physics.noslip_iterations.to_string()),
            ("iterations", physics.solver_iterations.to_string()),
        ],
    )
}

/// Returns the options, with the integrator that a hand needs whose servos feed velocity back: the usual one is not
/// stable with much of it.
fn hand_option(model: &Element, physics: &PhysicsConfig) -> Element {
    const INTEGRATOR: &str = "integrator";
    const IMPLICIT: &str = "implicit";
    let mut option = option(physics);
    if elements(model).any(|own| own.name == "option" && attribute(own, INTEGRATOR) == Some(IMPLICIT)) {
        set(&mut option, INTEGRATOR, IMPLICIT);
    }
    option
}

/// Makes room for several times the contacts of a grasp. Each thread allocates this memory once for each object. Steps
/// at which it is full are counted.
fn size(model: &Element, physics: &PhysicsConfig) -> Element {
    fn geoms(parent: &Element) -> usize {
        elements(parent).map(|child| usize::from(child.name == "geom") + geoms(child)).sum()
    }
    let hand_geoms: usize = elements(model).filter(|s| s.name == "worldbody").map(geoms).sum();
    let for_each_geom = if physics.self_collision { 4 } else { 2 };
    let contacts = 30 + for_each_geom * hand_geoms;
    // Constraint rows of one contact with the object, which has six dimensions.
    let rows = match physics.cone {
        Cone::Elliptic => 6,
        Cone::Pyramidal => 10,
    };
    element("size", &[("nconmax", contacts.to_string()), ("njmax", (rows * contacts + 200).to_string())])
}

fn visual() -> Element {
    let mut visual = Element::new("visual");
    append(&mut visual, element("headlight", &[("ambient", "0.4 0.4 0.4".into()), ("diffuse", "0.5 0.5 0.5".into())]));
    append(&mut visual, element("map", &[("znear", "0.005".into())]));
    visual
}

/// Leaves the scene's default class as MuJoCo has it, and puts the hand's defaults into a named class below it.
fn defaults(model: &Element) -> Element {
    let mut hand_class = element("default", &[("class", HAND_CLASS.to_owned())]);
    for own in elements(model).filter(|section| section.name == "default") {
        merge_defaults(&mut hand_class, own);
    }
    let mut main = Element::new("default");
    append(&mut main, hand_class);
    main
}

/// Merges one default section into another: MJCF allows several sections, but each element only once in a class.
fn merge_defaults(into: &mut Element, from: &Element) {
    for child in elements(from) {
        let class = child.attributes.get("class");
        let same = |e: &Element| e.name == child.name && (e.name != "default" || e.attributes.get("class") == class);
        let known = elements_mut(into).find(|e| same(e));
        if let Some(known) = known {
            known.attributes.extend(child.attributes.iter().map(|(key, value)| (key.clone(), value.clone())));
            if child.name == "default" {
                merge_defaults(known, child);
            }
        } else {
            append(into, child.clone());
        }
    }
}

fn light() -> Element {
    element("light", &[("name", "scene/light".into()), ("pos", "0.3 -0.4 1.5".into()), ("dir", "-0.2 0.25 -1".into())])
}

fn plane() -> Element {
    element(
        "geom",
        &[
            ("name", PLANE.into()),
            ("type", "plane".into()),
            ("size", "1 1 0.05".into()),
            ("contype", "1".into()),
            ("conaffinity", "1".into()),
            ("condim", "3".into()),
            ("friction", "1 0.005 0.0001".into()),
            ("rgba", "0.55 0.6 0.62 1".into()),
        ],
    )
}

fn object_body(object: &Object, physics: &PhysicsConfig) -> Element {
    let (kind, size) = object.shape.geom();
    let upright = object.shape.depth_below_centre(&nalgebra::UnitQuaternion::identity());
    let mut body = element("body", &[("name", OBJECT.into()), ("pos", numbers(&[0.0, 0.0, upright]))]);
    append(&mut body, element("freejoint", &[("name", OBJECT_JOINT.into())]));
    let shape = match size {
        Some(size) => ("size", size),
        None => ("mesh", OBJECT_MESH.to_owned()),
    };
    append(
        &mut body,
        element(
            "geom",
            &[
                ("name", OBJECT_GEOM.into()),
                ("type", kind.into()),
                shape,
                ("mass", object.mass.to_string()),
                ("contype", "1".into()),
                ("conaffinity", "1".into()),
                ("condim", "6".into()),
                ("priority", OBJECT_PRIORITY.to_string()),
                ("friction", numbers(&physics.friction_of(object, middle(physics.friction)))),
                ("rgba", "0.85 0.45 0.2 1".into()),
            ],
        ),
    );
    body
}

/// Returns the slide's carriage with the hand's root bodies in it.
fn mount(hand: &Hand) -> Result<Element, SimError> {
    let slide = &hand.manifest.slide;
    let mut carriage = element("body", &[("name", MOUNT.into())]);
    append(
        &mut carriage,
        element(
            "joint",
            &[
                ("name", slide.name.clone()),
                ("type", "slide".into()),
                ("axis", "0 0 1".into()),
                ("limited", "true".into()),
                ("range", numbers(&slide.range)),
                ("damping", slide.damping.to_string()),
                ("armature", slide.armature.to_string()),
            ],
        ),
    );
    // MuJoCo needs a mass in every body that moves.
    append(
        &mut carriage,
        element(
            "inertial",
            &[
                ("pos", "0 0 0".into()),
                ("mass", CARRIAGE_MASS.to_string()),
                ("diaginertia", numbers(&[CARRIAGE_INERTIA; 3])),
            ],
        ),
    );
    let mut base = element(
        "body",
        &[
            ("name", "scene/base".into()),
            ("pos", numbers(&hand.manifest.mount.position)),
            ("quat", numbers(&hand.manifest.mount.quaternion_wxyz())),
            ("childclass", HAND_CLASS.into()),
        ],
    );
    for world in elements(&hand.model).filter(|section| section.name == "worldbody") {
        base.children.extend(
            world
                .children
                .iter()
                .filter(|c| matches!(c, XMLNode::Element(e) if matches!(e.name.as_str(), "body" | "geom" | "site")))
                .cloned(),
        );
    }
    if !elements(&base).any(|child| child.name == "body") {
        return Err(SimError::Hand {
            hand: hand.manifest.name.clone(),
            reason: format!("{} has no <body> in its <worldbody>", hand.manifest.model),
        });
    }
    append(&mut carriage, base);
    Ok(carriage)
}

/// Returns a position servo that balances the hand's weight.
///
/// With a joint damping `d`, a force of `weight + d * speed` makes the hand rise at `speed` at most, so a limit on the
/// force limits the speed.
fn slide_servo(hand: &Hand, lifted_mass: f64) -> Element {
    let slide = &hand.manifest.slide;
    let weight = lifted_mass * STANDARD_GRAVITY;
    let upward = match slide.rise_speed {
        Some(speed) => (weight + slide.damping * speed).min(weight + slide.force_limit),
        None => weight + slide.force_limit,
    };
    element(
        "general",
        &[
            ("name", slide.name.clone()),
            ("joint", slide.name.clone()),
            ("gear", "1".into()),
            ("ctrllimited", "true".into()),
            ("ctrlrange", numbers(&slide.range)),
            ("forcelimited", "true".into()),
            ("forcerange", numbers(&[weight - slide.force_limit, upward])),
            ("dyntype", "none".into()),
            ("gaintype", "fixed".into()),
            ("gainprm", slide.kp.to_string()),
            ("biastype", "affine".into()),
            ("biasprm", numbers(&[weight, -slide.kp, 0.0])),
        ],
    )
}

/// Reads the files that the hand's assets name, and gives each a unique name: two directories may hold files of the
/// same name.
fn collect_files(section: &mut Element, hand: &Hand, assets: &mut Vec<(String, Vec<u8>)>) -> Result<(), SimError> {
    for item in elements_mut(section) {
        let Some(file) = item.attributes.get("file").cloned() else { continue };
        let bytes = match hand.assets.iter().find(|(name, _)| *name == file) {
            Some((_, bytes)) => bytes.clone(),
            None => {
                let path = hand.compiler.asset_path(&item.name, &file, &hand.model_directory);
                read_regular(&path, LARGEST_FILE).map_err(|source| SimError::ReadAsset { path, source })?
            }
        };
        let (stem, extension) = (Path::new(&file).file_stem(), Path::new(&file).extension());
        if let Some(stem) = stem {
            item.attributes.entry("name".to_owned()).or_insert_with(|| stem.to_string_lossy().into_owned());
        }
        let extension = extension.map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let renamed = format!("{}_{}.{extension}", item.name, assets.len());
        set(item, "file", renamed.clone());
        assets.push((renamed, bytes));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Other options of a hand's file do not count; a hand that states none has the scene's usual integrator.
    #[test]
    fn a_scene_has_the_implicit_integrator_of_its_hand() {
        let physics = PhysicsConfig {
            timestep: 0.004,
            substeps: 10,
            cone: Cone::Elliptic,
            impratio: 10.0,
            noslip_iterations: 3,
            solver_iterations: 20,
            friction: [1.0, 1.0],
            torsional_friction: 0.01,
            rolling_friction: 0.002,
            self_collision: false,
        };
        for (stated, expected) in [(None, None), (Some("RK4"), None), (Some("implicit"), Some("implicit"))] {
            let mut model = Element::new("mujoco");
            let mut own = element("option", &[("timestep", "1".to_owned())]);
            if let Some(integrator) = stated {
                set(&mut own, "integrator", integrator);
            }
            append(&mut model, own);
            let option = hand_option(&model, &physics);
            assert_eq!(attribute(&option, "integrator"), expected);
            assert_eq!(attribute(&option, "timestep"), Some("0.004"));
        }
    }
}
