//! Default classes of MuJoCo's model files: what elements say that leave it to their class.

use std::{collections::HashMap, iter};

use roxmltree::Node;

use super::mjcf_reader::{DEEPEST, elements};
use crate::InputError;

/// The default classes of a file by their names.
#[derive(Default)]
pub struct Classes(HashMap<String, Class>);

/// What a class says itself; the rest is said by the class that it is within.
struct Class {
    parent: Option<String>,
    /// Values by element and attribute.
    own: HashMap<(String, String), String>,
}

impl Classes {
    /// Reads all classes of a model.
    ///
    /// # Errors
    /// If too many are within one another.
    pub fn read(file: &str, root: Node) -> Result<Self, InputError> {
        let mut classes = Self::default();
        for default in elements(root, "default") {
            classes.add(file, default, None, 0)?;
        }
        Ok(classes)
    }

    fn add(&mut self, file: &str, node: Node, parent: Option<&str>, depth: usize) -> Result<(), InputError> {
        if depth > DEEPEST {
            return Err(InputError::new(file, "default", format!("{depth} classes within one another"), "fewer"));
        }
        let name = node.attribute("class").unwrap_or("main");
        let mut own = HashMap::new();
        for element in node.children().filter(|it| it.is_element() && !it.has_tag_name("default")) {
            let key = |attribute: &str| (element.tag_name().name().to_owned(), attribute.to_owned());
            own.extend(element.attributes().map(|it| (key(it.name()), it.value().to_owned())));
        }
        for nested in elements(node, "default") {
            self.add(file, nested, Some(name), depth + 1)?;
        }
        self.0.insert(name.to_owned(), Class { parent: parent.map(str::to_owned), own });
        Ok(())
    }

    /// What a class says about an attribute of an element, or the innermost of those around it.
    pub fn attribute(&self, class: &str, element: &str, attribute: &str) -> Option<&str> {
        let key = (element.to_owned(), attribute.to_owned());
        // Classes of one name may be within each other.
        let around = |it: &&Class| self.0.get(it.parent.as_ref()?);
        let mut classes = iter::successors(self.0.get(class), around).take(DEEPEST + 1);
        classes.find_map(|it| it.own.get(&key)).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_are_those_of_the_innermost_class_that_has_them() {
        let classes = r#"<default class="a"><default class="b"><default class="a"><joint range="-9 9"/></default>
            <joint axis="1 0 0"/></default><joint axis="0 1 0" armature="0.1"/></default>"#;
        let text = format!("<mujoco><default>{classes}</default></mujoco>");
        let document = roxmltree::Document::parse(&text).unwrap();
        let classes = Classes::read("arm.xml", document.root_element()).unwrap();
        let of = |class, name| classes.attribute(class, "joint", name);
        assert_eq!((of("b", "axis"), of("b", "armature"), of("b", "range")), (Some("1 0 0"), Some("0.1"), None));
        assert_eq!((of("a", "axis"), of("main", "axis"), of("none", "axis")), (Some("0 1 0"), None, None));
    }
}
