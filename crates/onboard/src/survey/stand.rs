//! The stand on which a hand is surveyed.

use eigenhand_hands::xml::{append, element, elements_mut, print, retain_elements};
use eigenhand_hands::xmltree::Element;

/// Name of the body that carries the hand while it is surveyed.
pub(super) const CARRIAGE: &str = "survey/carriage";
/// Time step in s of the survey's simulation.
pub(super) const TIMESTEP: f64 = 0.004;

/// Returns MJCF text of the hand alone on a heavy carriage, so that no part of the hand is fixed to the world.
pub(super) fn stand(root: &Element, contacts: &str) -> String {
    let mut stand = root.clone();
    // The import states no option but the integrator that the hand needs.
    retain_elements(&mut stand, |e| e.name != "size");
    let flag = element("flag", &[("gravity", "disable".into()), ("contact", contacts.to_owned())]);
    let mut option = element("option", &[("timestep", TIMESTEP.to_string())]);
    append(&mut option, flag);
    append(&mut stand, option);
    append(&mut stand, element("size", &[("nconmax", "1000".into()), ("njmax", "4000".into())]));
    for world in elements_mut(&mut stand).filter(|e| e.name == "worldbody") {
        let mut carriage = element("body", &[("name", CARRIAGE.into())]);
        let inertial = [("pos", "0 0 0"), ("mass", "1000"), ("diaginertia", "10 10 10")];
        append(&mut carriage, element("inertial", &inertial.map(|(key, value)| (key, value.to_owned()))));
        let slide =
            [("name", CARRIAGE), ("type", "slide"), ("axis", "0 0 1"), ("limited", "false"), ("stiffness", "0")];
        append(&mut carriage, element("joint", &slide.map(|(key, value)| (key, value.to_owned()))));
        carriage.children.append(&mut world.children);
        append(world, carriage);
    }
    print(&stand)
}
