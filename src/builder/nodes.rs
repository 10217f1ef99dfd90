//! The nodes of a scene: their marks, and the shapes that they share.

use std::fmt::Write;

#[cfg(feature = "gltf_scenes")]
use bevy::prelude::{Reflect, ReflectDefault};
use glam::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

/// Body of a node in a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "gltf_scenes", derive(Reflect), reflect(Default, Clone, PartialEq))]
#[serde(rename_all = "lowercase")]
pub enum NodeBody {
    /// A dynamic rigid body.
    Dynamic,
    /// A fixed one.
    #[default]
    Fixed,
    /// A body that the app moves.
    Kinematic,
    /// A shape of the body above it.
    Part,
    /// The node has no shape.
    NoShape,
}

/// Settings that a node carries in its file, in its name or its glTF extras.
///
/// A name may end in `-medial` (a dynamic body), `-medialstatic` (a fixed one) or `-noshape`, before digits such as `.001`. The extras of the node or of its
/// mesh may contain `"medial"`: true or false for a shape or no shape, or an object such as `{"body": "dynamic", "budget": 1.0}`. The body is `dynamic`,
/// `fixed`, `kinematic`, `part` or `noshape`, and the budget is in percent of the diagonal. Extras of the node precede those of the mesh, and those the name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NodeMark {
    /// The body.
    pub body: Option<NodeBody>,
    /// Error that the shape may have while the app runs, in percent of its diagonal.
    pub budget: Option<f32>,
}

impl NodeMark {
    /// Reads the name of a node, and the extras of the node and its mesh as JSON texts.
    ///
    /// # Errors
    /// A description of an invalid value of `"medial"`.
    pub fn new<'a>(name: &str, extras: impl IntoIterator<Item = &'a str>) -> Result<Self, String> {
        let stem = name.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.' || c.is_whitespace()).to_lowercase();
        let marks =
            [("-medial", NodeBody::Dynamic), ("-medialstatic", NodeBody::Fixed), ("-noshape", NodeBody::NoShape)];
        let named = marks.into_iter().find(|(mark, _)| stem.ends_with(mark)).map(|(_, body)| body);
        let mut mark = Self::default();
        for text in extras {
            let Self { body, budget } = Self::of_extras(text)?;
            mark = Self { body: mark.body.or(body), budget: mark.budget.or(budget) };
        }
        mark.body = mark.body.or(named);
        Ok(mark)
    }

    fn of_extras(text: &str) -> Result<Self, String> {
        use serde_json::Value;

        let extras: Value = serde_json::from_str(text).unwrap_or_default();
        let invalid = |problem: &str| format!("\"medial\" of its extras is invalid: {problem}");
        let mark = match extras.get("medial") {
            None | Some(Value::Bool(true)) => Self::default(),
            Some(Value::Bool(false)) => Self { body: Some(NodeBody::NoShape), budget: None },
            Some(value @ Value::Object(_)) => Self::deserialize(value).map_err(|error| invalid(&error.to_string()))?,
            Some(_) => return Err(invalid("it is neither an object nor true or false")),
        };
        if mark.budget.is_some_and(|budget| !(budget.is_finite() && budget >= 0.0)) {
            return Err(invalid("the budget is not a number from 0 up"));
        }
        Ok(mark)
    }
}

/// Returns true if a name matches a pattern, in which each `*` stands for any text.
pub fn is_named(name: &str, pattern: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else { return name == pattern };
    let Some(mut name) = name.strip_prefix(start) else { return false };
    let mut parts: Vec<&str> = rest.split('*').collect();
    let end = parts.pop().unwrap_or_default();
    for part in parts {
        let Some(at) = name.find(part) else { return false };
        name = &name[at + part.len()..];
    }
    name.ends_with(end)
}

/// The scale of a node along its own axes relative to the largest one, in four digits. A shape of the node contains it, because a medial mesh is only scaled
/// uniformly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Proportions(pub Vec3);

impl Proportions {
    /// Proportions and largest scale of a linear map.
    ///
    /// # Errors
    /// A description of a map that is not a scale, then a rotation or a mirror.
    pub fn of(map: Mat3) -> Result<(Self, f32), &'static str> {
        /// Largest cosine between two axes, up to rounding.
        const SHEAR: f32 = 1e-3;
        let axes = [map.x_axis, map.y_axis, map.z_axis];
        let scale = Vec3::from_array(axes.map(Vec3::length));
        if !(scale.is_finite() && scale.min_element() > 0.0) {
            return Err("its scale is 0 or not finite");
        }
        let [x, y, z] = axes.map(|axis| axis / axis.length());
        if x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs()) > SHEAR {
            return Err("a node above it is stretched and shears it; apply the scale of that node");
        }
        let largest = scale.max_element();
        Ok((Self((scale / largest).map(rounded)), largest))
    }

    /// The file name of the shape of a mesh, without its extension.
    pub fn file_name(&self, mesh: &str) -> String {
        /// Largest number of characters of a mesh's name in the name of a file.
        const LONGEST: usize = 100;
        let kept = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
        let mut name: String = mesh.chars().take(LONGEST).map(kept).collect();
        if name.starts_with('.') || name.is_empty() {
            name.insert(0, '_');
        }
        if self.0 != Vec3::ONE {
            let Vec3 { x, y, z } = self.0;
            // Text in memory cannot fail.
            let _ = write!(name, "_{x}x{y}x{z}");
        }
        name
    }
}

/// A number in four digits. Simple fractions are far from the places where the digits change, so that rounding errors change none.
fn rounded(value: f32) -> f32 {
    let digits = 10f64.powi(3 - f64::from(value).log10().floor() as i32);
    ((f64::from(value) * digits + 0.37).floor() / digits) as f32
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;

    #[test]
    fn names_and_extras_mark_nodes() {
        use NodeBody::{Dynamic, Fixed, Kinematic, NoShape, Part};

        let cases: [(&str, &[&str], _, _); 10] = [
            ("crate", &[], None, None),
            ("crate-medial", &[], Some(Dynamic), None),
            ("Wall-MedialStatic.001", &[], Some(Fixed), None),
            ("lamp-noshape 2", &[], Some(NoShape), None),
            ("crate-medial-broken", &[], None, None),
            ("crate", &[r#"{"medial": {"budget": 1.5, "body": "kinematic"}}"#], Some(Kinematic), Some(1.5)),
            ("crate-medial", &[r#"{"medial": {"budget": 0.5}}"#], Some(Dynamic), Some(0.5)),
            ("crate-medial", &[r#"{"price": 3}"#, r#"{"medial": false}"#], Some(NoShape), None),
            (
                "crate",
                &[r#"{"medial": {"body": "part"}}"#, r#"{"medial": {"body": "fixed", "budget": 2}}"#],
                Some(Part),
                Some(2.0),
            ),
            ("crate", &[r#"{"medial": true}"#, "null"], None, None),
        ];
        for (name, extras, body, budget) in cases {
            assert_eq!(NodeMark::new(name, extras.iter().copied()), Ok(NodeMark { body, budget }), "{name} {extras:?}");
        }
        for (extras, problem) in [
            (r#"{"medial": 3}"#, "it is neither an object nor true or false"),
            (r#"{"medial": {"budget": -1}}"#, "the budget is not a number from 0 up"),
            (r#"{"medial": {"body": "soft"}}"#, "unknown variant `soft`"),
            (r#"{"medial": {"mass": 1}}"#, "unknown field `mass`"),
        ] {
            let error = NodeMark::new("crate", [extras]).unwrap_err();
            assert!(error.starts_with(&format!("\"medial\" of its extras is invalid: {problem}")), "{error}");
        }
    }

    #[test]
    fn patterns_match_names() {
        for (pattern, name, expected) in [
            ("crate", "crate", true),
            ("crate", "crates", false),
            ("crate*", "crate.001", true),
            ("*-rock", "big-rock", true),
            ("*-rock", "big-rocks", false),
            ("a*b*c", "a1b2b3c", true),
            ("a*b*c", "a1c", false),
            ("ab*ba", "aba", false),
            ("*", "", true),
        ] {
            assert_eq!(is_named(name, pattern), expected, "{pattern} {name}");
        }
    }

    #[test]
    fn proportions_name_files() {
        let turn = Mat3::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1));
        let mut random = crate::random::Random(8);
        for (scale, name) in [
            (Vec3::ONE, "big_crate"),
            (Vec3::new(1.0, -1.0, 1.0), "big_crate"),
            (Vec3::new(1.0, 0.5, 0.25), "big_crate_1x0.5x0.25"),
            (Vec3::new(0.001, 0.0625, 1.0), "big_crate_0.001x0.0625x1"),
            (Vec3::new(1.0 / 3.0, 1.0, 2.0 / 3.0), "big_crate_0.3333x1x0.6667"),
        ] {
            for _ in 0..200 {
                let size = 0.1 + 10.0 * random.unit();
                let (proportions, largest) = Proportions::of(turn * Mat3::from_diagonal(scale * size)).unwrap();
                assert_eq!(proportions.file_name("big/crate"), name);
                assert!((largest / size - 1.0).abs() < 1e-5);
            }
        }
        let stretch = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 1.0));
        assert!(Proportions::of(stretch * turn).unwrap_err().contains("shears"));
        assert!(Proportions::of(Mat3::from_diagonal(Vec3::new(1.0, 0.0, 1.0))).unwrap_err().contains("is 0"));
        assert_eq!(Proportions(Vec3::ONE).file_name(".."), "_..");
    }
}
