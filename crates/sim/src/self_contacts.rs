//! Contacts between the links of a hand: which geoms take part, and which pairs of bodies are left out.

use std::collections::BTreeMap;
use std::sync::Arc;

use eigenhand_hands::Hand;
use eigenhand_hands::xml::{append, element, elements_mut, set};
use eigenhand_hands::xmltree::Element;
use eigenhand_mujoco::{BodyId, Contact, Data, Model, MuJoCo};

use crate::SimError;
use crate::scene::{MOUNT, Scene};
use crate::task::Addresses;

/// Contact bit that only geoms of the hand have.
const BIT: i32 = 1 << 20;
/// Compilations after which the search for overlapping bodies ends. Each finds at least one pair.
const ROUNDS: usize = 50;

/// What the scene needs so that the links of a hand collide with one another.
///
/// MuJoCo itself leaves out geoms of one body, of bodies that are welded together, and of a body and its parent.
#[derive(Clone, Debug)]
pub struct SelfContacts {
    /// For each geom of the hand, in the model's order: `contype` and `conaffinity`. Both are 0 for a geom that collides
    /// with nothing.
    bits: Vec<(i32, i32)>,
    overlaps: Vec<Overlap>,
}

/// A pair of bodies that overlap in the open posture, and so do not collide.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// Names of both bodies.
    pub bodies: [String; 2],
    /// Deepest penetration in m.
    pub depth: f64,
}

impl SelfContacts {
    /// Reads the hand's geoms from a compiled scene, and finds the bodies that overlap in the open posture.
    ///
    /// `compose` returns the scene with the contacts that it is given.
    ///
    /// # Errors
    /// [`SimError::Hand`] when the scene's geoms cannot be told apart, [`SimError::MuJoCo`] when the scene does not
    /// compile.
    pub(crate) fn find(
        library: &Arc<MuJoCo>,
        hand: &Hand,
        without: &Model,
        compose: impl Fn(&SelfContacts) -> Result<Scene, SimError>,
    ) -> Result<SelfContacts, SimError> {
        let is_hand = without.geoms_below(without.body(MOUNT)?);
        let geoms = without.geoms().filter(|geom| is_hand[geom.index()]);
        let bits = geoms.map(|geom| without.geom_contact_bits(geom)).collect();
        let mut found = SelfContacts { bits, overlaps: Vec::new() };
        for _ in 0..ROUNDS {
            let scene = compose(&found)?;
            let model = Arc::new(Model::from_xml(library, &scene.xml, &scene.assets)?);
            let overlapping = overlapping_bodies(&model, &Addresses::resolve(&model, hand)?)?;
            if overlapping.is_empty() {
                break;
            }
            let named = |([a, b], depth): ([BodyId; 2], f64)| Overlap {
                bodies: [model.body_name(a), model.body_name(b)],
                depth,
            };
            found.overlaps.extend(overlapping.into_iter().map(named));
        }
        Ok(found)
    }

    /// Lists the pairs of bodies that overlap in the open posture.
    pub fn overlaps(&self) -> &[Overlap] {
        &self.overlaps
    }

    /// Lets the geoms in `mount` collide with one another. Bodies without a name get one.
    ///
    /// # Errors
    /// [`SimError::Hand`] when `mount` has another number of geoms than the compiled model.
    pub(crate) fn apply(&self, mount: &mut Element, hand: &Hand) -> Result<(), SimError> {
        let mut bits = self.bits.iter();
        let mut bodies = 0;
        let complete = apply_to_body(mount, &mut bits, &mut bodies) && bits.next().is_none();
        complete.then_some(()).ok_or_else(|| SimError::Hand {
            hand: hand.manifest.name.clone(),
            reason:
                "physics.self_collision needs a model that states every geom as a <geom> of its own body; change the \
                     model, or set physics.self_collision=false"
                    .to_owned(),
        })
    }

    /// Adds the overlapping pairs, as excluded, to the scene's section `contact`.
    pub(crate) fn exclude(&self, contact: &mut Element) {
        for Overlap { bodies: [a, b], .. } in &self.overlaps {
            append(contact, element("exclude", &[("body1", a.clone()), ("body2", b.clone())]));
        }
    }
}

/// Sets the bits of the geoms of a body and of its descendants, in the order of the compiled model: a body's own geoms
/// come before those of its children. Returns false if there are more geoms than bits.
fn apply_to_body<'a>(body: &mut Element, bits: &mut impl Iterator<Item = &'a (i32, i32)>, bodies: &mut usize) -> bool {
    body.attributes.entry("name".to_owned()).or_insert_with(|| format!("scene/body{bodies}"));
    *bodies += 1;
    for geom in elements_mut(body).filter(|child| child.name == "geom") {
        let Some(&(contype, conaffinity)) = bits.next() else { return false };
        if contype != 0 || conaffinity != 0 {
            set(geom, "contype", (contype | BIT).to_string());
            set(geom, "conaffinity", (conaffinity | BIT).to_string());
        }
    }
    elements_mut(body).filter(|child| child.name == "body").all(|child| apply_to_body(child, bits, bodies))
}

/// Lists the pairs of bodies of the hand that touch in the open posture, with their deepest penetration in m.
fn overlapping_bodies(model: &Arc<Model>, at: &Addresses) -> Result<BTreeMap<[BodyId; 2], f64>, SimError> {
    let mut data = Data::new(model)?;
    data.qpos_mut().copy_from_slice(&at.start_qpos);
    data.forward();
    let mut pairs = BTreeMap::new();
    for contact in data.contacts().filter(|contact| between_links(contact, at)) {
        let [a, b] = contact.geoms.map(|geom| model.geom_body(geom));
        let deepest: &mut f64 = pairs.entry([a.min(b), a.max(b)]).or_default();
        *deepest = deepest.max(-contact.distance);
    }
    Ok(pairs)
}

/// Tells whether both geoms of a contact belong to the hand.
fn between_links(contact: &Contact, at: &Addresses) -> bool {
    contact.geoms.iter().all(|geom| at.is_hand[geom.index()])
}

/// Returns the deepest penetration between two geoms of the hand, in m.
pub(crate) fn deepest(data: &Data, at: &Addresses) -> f64 {
    data.contacts().filter(|contact| between_links(contact, at)).map(|c| -c.distance).fold(0.0, f64::max)
}
