//! MJCF as MuJoCo 2.2.2 reads it: compiler settings, default classes and typed attributes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use xmltree::{AttributeMap, Element};

use crate::error::HandError;
use crate::xml::{attribute, elements, elements_mut};

/// Name that MuJoCo gives to the outermost default class.
const MAIN_CLASS: &str = "main";

/// Lists the elements in all top-level sections named `section`; MJCF allows a section to be repeated.
pub(crate) fn section<'a>(root: &'a Element, section: &'a str) -> impl Iterator<Item = &'a Element> {
    elements(root).filter(move |e| e.name == section).flat_map(elements)
}

/// Calls `act` with every element below `parent`, and with the `childclass` of the bodies around it.
fn each_in_bodies<E>(
    parent: &mut Element,
    childclass: Option<&str>,
    act: &mut impl FnMut(&mut Element, Option<&str>) -> Result<(), E>,
) -> Result<(), E> {
    for child in elements_mut(parent) {
        let own = attribute(child, "childclass").map(str::to_owned);
        let class = own.as_deref().or(childclass);
        act(child, class)?;
        if child.name == "body" {
            each_in_bodies(child, class, act)?;
        }
    }
    Ok(())
}

/// Calls `act` with every element of the world, and with the `childclass` of the bodies around it.
pub(crate) fn each_in_world<E>(
    root: &mut Element,
    act: &mut impl FnMut(&mut Element, Option<&str>) -> Result<(), E>,
) -> Result<(), E> {
    elements_mut(root).filter(|e| e.name == "worldbody").try_for_each(|world| each_in_bodies(world, None, act))
}

/// Reads a number of each joint that has a name; 0 where the file states none.
pub(crate) fn of_each_joint(
    root: &mut Element,
    defaults: &Defaults,
    key: &str,
    file: &Path,
) -> Result<BTreeMap<String, f64>, HandError> {
    let mut found = BTreeMap::new();
    each_in_world(root, &mut |element, class| {
        if let Some(name) = element.attributes.get("name").filter(|_| element.name == "joint") {
            found.insert(name.clone(), defaults.resolve(element, class, file)?.number(key)?.unwrap_or(0.0));
        }
        Ok::<(), HandError>(())
    })?;
    Ok(found)
}

/// Unit of angles in a model file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngleUnit {
    /// Degrees, the default of MJCF.
    Degree,
    /// Radians.
    Radian,
}

/// Settings of the `<compiler>` element that change the meaning of a hand's numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Compiler {
    /// Unit of hinge ranges and of written orientations.
    pub angle: AngleUnit,
    /// True if a range alone makes a joint or control limited.
    pub autolimits: bool,
    /// Folder of meshes, relative to the model file.
    pub mesh_dir: String,
    /// Folder of textures, relative to the model file.
    pub texture_dir: String,
    /// True if folders in asset file names are dropped.
    pub strip_path: bool,
}

impl Compiler {
    /// Reads the settings of `root`, later `<compiler>` elements over earlier ones.
    pub(crate) fn read(root: &Element, file: &Path) -> Result<Self, HandError> {
        let mut compiler = Self {
            angle: AngleUnit::Degree,
            autolimits: false,
            mesh_dir: String::new(),
            texture_dir: String::new(),
            strip_path: false,
        };
        for element in elements(root).filter(|e| e.name == "compiler") {
            let attributes = Attributes::of(element, file);
            match element.attributes.get("angle").map(String::as_str) {
                Some("radian") => compiler.angle = AngleUnit::Radian,
                Some("degree") => compiler.angle = AngleUnit::Degree,
                None => {}
                Some(other) => {
                    return Err(HandError::model(file, "compiler angle", "`degree` or `radian`", format!("`{other}`")));
                }
            }
            compiler.autolimits = attributes.flag("autolimits")?.unwrap_or(compiler.autolimits);
            compiler.strip_path = attributes.flag("strippath")?.unwrap_or(compiler.strip_path);
            if let Some(folder) = element.attributes.get("assetdir") {
                compiler.mesh_dir.clone_from(folder);
                compiler.texture_dir.clone_from(folder);
            }
            if let Some(folder) = element.attributes.get("meshdir") {
                compiler.mesh_dir.clone_from(folder);
            }
            if let Some(folder) = element.attributes.get("texturedir") {
                compiler.texture_dir.clone_from(folder);
            }
        }
        Ok(compiler)
    }

    /// Returns the path of the file that an asset element names as `written`, for an element `kind` (`mesh`, `texture`,
    /// ...) of a model in `directory`.
    pub fn asset_path(&self, kind: &str, written: &str, directory: &Path) -> PathBuf {
        let folder = if kind == "texture" { &self.texture_dir } else { &self.mesh_dir };
        let name = if self.strip_path { written.rsplit(['/', '\\']).next().unwrap_or(written) } else { written };
        directory.join(folder).join(name)
    }

    /// Converts a hinge angle of the file to radians.
    pub(crate) fn radians(&self, angle: f64) -> f64 {
        match self.angle {
            AngleUnit::Degree => angle.to_radians(),
            AngleUnit::Radian => angle,
        }
    }
}

/// Default classes of a model, each with its inherited values.
#[derive(Debug, Default)]
pub(crate) struct Defaults {
    classes: BTreeMap<String, BTreeMap<String, AttributeMap<String, String>>>,
    main: String,
}

impl Defaults {
    /// Reads all default classes of `root`.
    pub(crate) fn read(root: &Element, file: &Path) -> Result<Self, HandError> {
        let mut defaults = Self { classes: BTreeMap::new(), main: MAIN_CLASS.to_owned() };
        for (i, top) in elements(root).filter(|e| e.name == "default").enumerate() {
            let name = top.attributes.get("class").map_or(MAIN_CLASS, String::as_str);
            if i == 0 {
                defaults.main = name.to_owned();
            }
            let inherited = defaults.classes.get(name).cloned().unwrap_or_default();
            defaults.add(name, top, inherited, file)?;
        }
        defaults.classes.entry(defaults.main.clone()).or_default();
        Ok(defaults)
    }

    fn add(
        &mut self,
        name: &str,
        element: &Element,
        mut values: BTreeMap<String, AttributeMap<String, String>>,
        file: &Path,
    ) -> Result<(), HandError> {
        for child in elements(element).filter(|e| e.name != "default") {
            let merged = values.entry(family(&child.name).to_owned()).or_default();
            for (key, value) in &child.attributes {
                merged.insert(key.clone(), value.clone());
            }
        }
        self.classes.insert(name.to_owned(), values.clone());
        for child in elements(element).filter(|e| e.name == "default") {
            let Some(class) = child.attributes.get("class") else {
                return Err(HandError::model(
                    file,
                    format!("<default> inside class `{name}`"),
                    "an attribute `class`",
                    "none",
                ));
            };
            let inherited = match self.classes.get(class) {
                Some(earlier) => earlier.clone(),
                None => values.clone(),
            };
            self.add(class, child, inherited, file)?;
        }
        Ok(())
    }

    /// Merges the attributes of `element` over the defaults of its class. The class is its own, otherwise the
    /// `childclass` of the bodies around it, otherwise the main class.
    pub(crate) fn resolve(
        &self,
        element: &Element,
        childclass: Option<&str>,
        file: &Path,
    ) -> Result<Attributes, HandError> {
        let class = element.attributes.get("class").map(String::as_str).or(childclass).unwrap_or(&self.main);
        let Some(values) = self.classes.get(class) else {
            let known = self.classes.keys().map(String::as_str);
            return Err(HandError::unresolved(
                file,
                format!("{} class", place(element)),
                "a default class",
                class,
                known,
            ));
        };
        let mut map = values.get(family(&element.name)).cloned().unwrap_or_default();
        for (key, value) in &element.attributes {
            map.insert(key.clone(), value.clone());
        }
        Ok(Attributes { place: place(element), map, file: file.to_path_buf() })
    }
}

/// Returns the name under which defaults of `tag` are kept: in MuJoCo all actuator shortcuts share one default.
fn family(tag: &str) -> &str {
    match tag {
        "motor" | "position" | "velocity" | "intvelocity" | "damper" | "cylinder" | "muscle" | "adhesion" => "general",
        "fixed" | "spatial" => "tendon",
        other => other,
    }
}

fn place(element: &Element) -> String {
    match element.attributes.get("name") {
        Some(name) => format!("{} `{name}`", element.name),
        None => format!("<{}>", element.name),
    }
}

/// Attributes of an element with typed access.
#[derive(Debug)]
pub(crate) struct Attributes {
    place: String,
    map: AttributeMap<String, String>,
    file: PathBuf,
}

impl Attributes {
    /// Takes the attributes of `element` alone, without defaults.
    pub(crate) fn of(element: &Element, file: &Path) -> Self {
        Self { place: place(element), map: element.attributes.clone(), file: file.to_path_buf() }
    }

    pub(crate) fn text(&self, key: &str) -> Option<&str> {
        self.map.get(key).map(String::as_str)
    }

    /// Describes the element in messages.
    pub(crate) fn place(&self) -> &str {
        &self.place
    }

    pub(crate) fn error(&self, key: &str, expected: &str, got: impl ToString) -> HandError {
        HandError::model(&self.file, format!("{} {key}", self.place), expected, got)
    }

    /// Reads `true` or `false`; `auto` counts as absent.
    pub(crate) fn flag(&self, key: &str) -> Result<Option<bool>, HandError> {
        match self.text(key) {
            None | Some("auto") => Ok(None),
            Some("true") => Ok(Some(true)),
            Some("false") => Ok(Some(false)),
            Some(other) => Err(self.error(key, "`true`, `false` or `auto`", format!("`{other}`"))),
        }
    }

    pub(crate) fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>, HandError> {
        let Some(text) = self.text(key) else {
            return Ok(None);
        };
        let parsed: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse::<f64>).collect();
        match parsed {
            Ok(values) if !values.is_empty() && values.iter().all(|v| v.is_finite()) => Ok(Some(values)),
            _ => Err(self.error(key, "finite numbers", format!("`{text}`"))),
        }
    }

    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>, HandError> {
        Ok(self.numbers(key)?.map(|values| values[0]))
    }

    /// Reads a range, if it applies: `range_key` is present and `limited_key` is not false.
    pub(crate) fn limits(&self, range_key: &str, limited_key: &str) -> Result<Option<(f64, f64)>, HandError> {
        let range = self.numbers(range_key)?;
        match (range, self.flag(limited_key)?) {
            (_, Some(false)) | (None, None) => Ok(None),
            (None, Some(true)) => Err(self.error(range_key, "two numbers, because it is limited", "none")),
            (Some(values), _) => match values[..] {
                [low, high] if low < high => Ok(Some((low, high))),
                // For MuJoCo, a range of 0 0 means no range.
                [low, high] if low == 0.0 && high == 0.0 => Ok(None),
                _ => Err(self.error(range_key, "two numbers, the lower first", format!("{values:?}"))),
            },
        }
    }
}
