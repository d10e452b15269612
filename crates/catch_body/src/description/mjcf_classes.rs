//! Default classes of MuJoCo's model files: what elements say that leave it to their class.

use std::{collections::HashMap, iter};

use super::mjcf_reader::DEEPEST;
use crate::{InputError, document::Node};

/// The class of what names none; sections of the outermost level are all of this one.
pub const MAIN: &str = "main";
/// Elements that all are actuators, whose defaults are one.
const ACTUATORS: [&str; 11] = [
    "general",
    "motor",
    "position",
    "velocity",
    "intvelocity",
    "damper",
    "cylinder",
    "muscle",
    "adhesion",
    "dcmotor",
    "plugin",
];

/// The default classes of a file by their names.
#[derive(Default)]
pub struct Classes<'a>(HashMap<&'a str, Class<'a>>);

/// What a class says itself; the rest is said by the class that it is within.
#[derive(Default)]
struct Class<'a> {
    parent: Option<&'a str>,
    /// Values by element and attribute.
    own: HashMap<(&'a str, &'a str), &'a str>,
}

impl<'a> Classes<'a> {
    /// Reads all classes of a model.
    ///
    /// # Errors
    /// If too many are within one another, or two have one name.
    pub fn read(root: Node<'a>) -> Result<Self, InputError> {
        let mut classes = Self::default();
        for default in root.children("default") {
            if let Some(other) = default.attribute("class").filter(|it| *it != MAIN) {
                let expected = "no class, or main: other classes are within it";
                return Err(default.fault(format!("class=\"{other}\""), expected));
            }
            classes.add(default, MAIN, None, 0)?;
        }
        Ok(classes)
    }

    fn add(&mut self, node: Node<'a>, name: &'a str, parent: Option<&'a str>, depth: usize) -> Result<(), InputError> {
        if depth > DEEPEST {
            return Err(node.fault(format!("{depth} classes within one another"), "fewer"));
        }
        if parent.is_some() && self.0.contains_key(name) {
            return Err(node.fault(format!("the class {name} twice"), "each class once"));
        }
        let class = self.0.entry(name).or_default();
        class.parent = parent;
        for element in node.elements().filter(|it| it.name() != "default") {
            element.stands_for_others();
            class.own.extend(element.raw_attributes().map(|(key, value)| ((kind(element.name()), key), value)));
        }
        for nested in node.children("default") {
            let missing = || nested.fault("no class", "a name for each class within another");
            let inner = nested.attribute("class").ok_or_else(missing)?;
            self.add(nested, inner, Some(name), depth + 1)?;
        }
        Ok(())
    }

    /// What a class says about an attribute of an element, or the innermost of those around it.
    pub fn attribute(&self, class: &str, element: &str, attribute: &str) -> Option<&'a str> {
        let around = |it: &&Class<'a>| self.0.get(it.parent?);
        let mut classes = iter::successors(self.0.get(class), around).take(DEEPEST + 2);
        classes.find_map(|it| it.own.get(&(kind(element), attribute))).copied()
    }

    /// Whether there is a class of this name.
    pub fn has(&self, class: &str) -> bool {
        class == MAIN || self.0.contains_key(class)
    }
}

/// All actuators have one name for their defaults.
fn kind(element: &str) -> &str {
    if ACTUATORS.contains(&element) { ACTUATORS[0] } else { element }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;

    #[test]
    fn attributes_are_those_of_the_innermost_class_that_has_them() {
        let classes = r#"<default class="a"><default class="b"><joint axis="1 0 0"/></default>
            <joint axis="0 1 0" armature="0.1"/><general forcerange="-1 1"/></default><joint damping="3"/>"#;
        let text = format!(
            "<mujoco><default>{classes}</default><default class=\"main\"><joint ref=\"1\"/></default></mujoco>"
        );
        let document = Document::from_xml("arm.xml", &text, "MJCF").unwrap();
        let classes = Classes::read(document.root()).unwrap();
        let of = |class, name| classes.attribute(class, "joint", name);
        assert_eq!((of("b", "axis"), of("b", "armature"), of("b", "range")), (Some("1 0 0"), Some("0.1"), None));
        assert_eq!((of("a", "axis"), of("main", "axis"), of("none", "axis")), (Some("0 1 0"), None, None));
        assert_eq!((of("b", "damping"), of("a", "ref")), (Some("3"), Some("1")));
        assert_eq!(classes.attribute("b", "position", "forcerange"), Some("-1 1"));
        for text in [
            "<mujoco><default class=\"foo\"/></mujoco>",
            "<mujoco><default><default class=\"a\"/><default class=\"a\"/></default></mujoco>",
            "<mujoco><default><default/></default></mujoco>",
        ] {
            let document = Document::from_xml("arm.xml", text, "MJCF").unwrap();
            assert!(Classes::read(document.root()).is_err());
        }
    }
}
