//! The tree of a URDF's links, connected by its joints.

use std::collections::HashMap;
use std::path::Path;

use urdf_rs::Robot;

use crate::error::HandError;

/// Longest chain of links that is read; real hands stay far below, and later steps recurse.
const MAX_DEPTH: usize = 200;

/// Links by index; in `order`, a parent comes before its children.
#[derive(Debug)]
pub(super) struct Tree {
    /// All links, root first.
    pub(super) order: Vec<usize>,
    /// For every link, its parent joint; none for the root.
    pub(super) joint: Vec<Option<usize>>,
    /// For every link, its parent link; none for the root.
    pub(super) parent: Vec<Option<usize>>,
    /// For every link, its children in the order of the file's joints.
    pub(super) children: Vec<Vec<usize>>,
}

impl Tree {
    /// Orders the links of `robot`; one chain of joints must lead from the root to each.
    pub(super) fn of(robot: &Robot, file: &Path) -> Result<Self, HandError> {
        refuse_repeated("link", robot.links.iter().map(|l| l.name.as_str()), file)?;
        refuse_repeated("joint", robot.joints.iter().map(|j| j.name.as_str()), file)?;
        let index: HashMap<&str, usize> = robot.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
        let n_links = robot.links.len();
        let mut tree = Self {
            order: Vec::with_capacity(n_links),
            joint: vec![None; n_links],
            parent: vec![None; n_links],
            children: vec![Vec::new(); n_links],
        };
        for (j, joint) in robot.joints.iter().enumerate() {
            let find = |key: &str, link: &str| {
                index.get(link).copied().ok_or_else(|| {
                    let known = robot.links.iter().map(|l| l.name.as_str());
                    HandError::unresolved(file, format!("joint `{}` <{key}>", joint.name), "a link", link, known)
                })
            };
            let parent = find("parent", &joint.parent.link)?;
            let child = find("child", &joint.child.link)?;
            if let Some(other) = tree.joint[child] {
                return Err(HandError::model(
                    file,
                    format!("link `{}`", joint.child.link),
                    "one parent joint",
                    format!("`{}` and `{}`; URDF cannot describe closed loops", robot.joints[other].name, joint.name),
                ));
            }
            tree.joint[child] = Some(j);
            tree.parent[child] = Some(parent);
            tree.children[parent].push(child);
        }
        tree.sort(robot, file)?;
        Ok(tree)
    }

    fn sort(&mut self, robot: &Robot, file: &Path) -> Result<(), HandError> {
        let name = |i: &usize| format!("`{}`", robot.links[*i].name);
        let roots: Vec<usize> = (0..self.joint.len()).filter(|&i| self.joint[i].is_none()).collect();
        let [root] = roots[..] else {
            let got = match roots.len() {
                0 => "none: the joints form a cycle".to_owned(),
                _ => roots.iter().map(name).collect::<Vec<_>>().join(", "),
            };
            return Err(HandError::model(file, "<robot>", "one root link, which is the child of no joint", got));
        };
        let mut level = vec![root];
        for _ in 0..MAX_DEPTH {
            self.order.extend(&level);
            level = level.iter().flat_map(|&i| self.children[i].iter().copied()).collect();
        }
        if !level.is_empty() {
            return Err(HandError::model(
                file,
                "<robot>",
                &format!("chains of at most {MAX_DEPTH} links"),
                "longer ones",
            ));
        }
        if self.order.len() < self.joint.len() {
            let loose: Vec<String> =
                (0..self.joint.len()).filter(|i| !self.order.contains(i)).map(|i| name(&i)).collect();
            let got = format!("a cycle of {}", loose.join(", "));
            return Err(HandError::model(file, "<robot>", "a path of joints from the root to every link", got));
        }
        Ok(())
    }
}

fn refuse_repeated<'a>(kind: &str, names: impl Iterator<Item = &'a str>, file: &Path) -> Result<(), HandError> {
    let mut seen = std::collections::HashSet::new();
    for name in names {
        if !seen.insert(name) {
            let place = format!("{kind} `{name}`");
            return Err(HandError::model(file, place, &format!("one {kind} of this name"), "two"));
        }
    }
    Ok(())
}
