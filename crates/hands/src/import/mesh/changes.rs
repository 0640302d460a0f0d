//! What was changed in the meshes of a model, for its notes.

use std::collections::BTreeMap;

use super::{MAX_FACES, Mesh};
use crate::notes::note;

/// Changes made to meshes, each with the names of the files.
#[derive(Debug, Default)]
pub(in crate::import) struct Changes {
    flat: Vec<String>,
    simplified: Vec<String>,
    pub(in crate::import) converted: Vec<String>,
    remarks: BTreeMap<String, Vec<String>>,
}

impl Changes {
    /// Simplifies the mesh of the file `base` until MuJoCo reads it. Returns true if it is flat: MuJoCo reads no flat
    /// mesh, so a thin box takes its place.
    pub(in crate::import) fn mend(&mut self, mesh: &mut Mesh, base: &str) -> bool {
        if let Some(remark) = mesh.note.take() {
            self.remarks.entry(remark).or_default().push(base.to_owned());
        }
        if mesh.simplify(MAX_FACES) {
            self.simplified.push(base.to_owned());
        }
        let flat = mesh.is_flat();
        if flat {
            self.flat.push(base.to_owned());
        }
        flat
    }

    /// Adds a note about each kind of change.
    pub(in crate::import) fn finish(self, notes: &mut Vec<String>) {
        note(notes, "meshes without volume became thin boxes", &self.flat);
        note(notes, "meshes with more faces than MuJoCo reads were simplified", &self.simplified);
        note(notes, "meshes that MuJoCo 2.2.2 does not read became binary STL", &self.converted);
        for (remark, files) in &self.remarks {
            note(notes, remark, files);
        }
    }
}
