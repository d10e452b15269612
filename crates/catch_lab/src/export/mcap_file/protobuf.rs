//! Protocol Buffers from one table: what a message looks like on the wire, and the descriptor by which readers know it.
//!
//! Only what the tables in `schemas.rs` use (Protocol Buffers documentation, "Encoding"; numbers of the descriptors' own fields
//! from `google/protobuf/descriptor.proto`).

/// A kind of message.
#[derive(Debug)]
pub struct MessageType {
    /// Its package, as `foxglove`.
    pub package: &'static str,
    /// Its name within the package.
    pub name: &'static str,
    /// The file that readers expect it to be declared in.
    pub file: &'static str,
    /// Name, number and kind of each field.
    pub fields: &'static [(&'static str, u32, Kind)],
}

/// What a field holds.
#[derive(Debug)]
pub enum Kind {
    /// A number.
    Double,
    /// A number that may be absent, which is not the same as 0.
    OptionalDouble,
    /// Any number of numbers.
    Doubles,
    /// Four bytes of a whole number.
    Fixed32,
    /// A whole number that is short if it is small.
    Int64,
    /// The same within 32 bits.
    Int32,
    /// Text.
    Text,
    /// Bytes.
    Bytes,
    /// One of the named values, counted from 0; the list has a name of its own.
    OneOf(&'static str, &'static [&'static str]),
    /// A message.
    Message(&'static MessageType),
    /// Any number of messages.
    Many(&'static MessageType),
}

/// What is put into a field.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// For numbers.
    Number(f64),
    /// For lists of numbers.
    Numbers(Vec<f64>),
    /// For whole numbers and named values.
    Whole(u32),
    /// For text.
    Text(String),
    /// For bytes.
    Bytes(Vec<u8>),
    /// For a message: field by field.
    Message(Fields),
    /// For many messages.
    Many(Vec<Fields>),
}

/// The fields of a message, by name.
pub type Fields = Vec<(&'static str, Content)>;

impl MessageType {
    /// The name with the package.
    pub fn full_name(&self) -> String {
        format!("{}.{}", self.package, self.name)
    }

    /// A message of this kind as it is on the wire.
    ///
    /// # Panics
    /// If a field is not of this kind of message, or its content does not suit it: a bug.
    pub fn encode(&self, content: &Fields) -> Vec<u8> {
        let mut wire = Wire::default();
        for (name, content) in content {
            let Some((_, number, kind)) = self.fields.iter().find(|(known, ..)| known == name) else {
                panic!("{} has no field {name}", self.full_name());
            };
            match (kind, content) {
                (Kind::Double | Kind::OptionalDouble, Content::Number(value)) => {
                    wire.key(*number, 1).0.extend(value.to_le_bytes());
                }
                (Kind::Doubles, Content::Numbers(values)) => {
                    wire.bytes(*number, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>());
                }
                (Kind::Fixed32, Content::Whole(value)) => wire.key(*number, 5).0.extend(value.to_le_bytes()),
                (Kind::Int64 | Kind::Int32 | Kind::OneOf(..), Content::Whole(value)) => {
                    wire.whole(*number, u64::from(*value));
                }
                (Kind::Text, Content::Text(text)) => wire.bytes(*number, text.as_bytes()),
                (Kind::Bytes, Content::Bytes(bytes)) => wire.bytes(*number, bytes),
                (Kind::Message(of), Content::Message(fields)) => wire.bytes(*number, &of.encode(fields)),
                (Kind::Many(of), Content::Many(messages)) => {
                    messages.iter().for_each(|fields| wire.bytes(*number, &of.encode(fields)));
                }
                (kind, content) => panic!("{}.{name} is {kind:?}, not {content:?}", self.full_name()),
            }
        }
        wire.0
    }

    /// The `FileDescriptorSet` of this kind of message and all that it contains, those that others need first.
    pub fn descriptor_set(&'static self) -> Vec<u8> {
        let mut set = Wire::default();
        let mut types = Vec::new();
        self.gather(&mut types);
        types.iter().for_each(|it| set.bytes(1, &it.file_descriptor()));
        set.0
    }

    fn gather(&'static self, types: &mut Vec<&'static Self>) {
        self.parts().for_each(|part| part.gather(types));
        if types.iter().all(|known| known.file != self.file) {
            types.push(self);
        }
    }

    /// The kinds of message in its fields.
    fn parts(&self) -> impl Iterator<Item = &'static Self> {
        self.fields.iter().filter_map(|(.., kind)| match kind {
            Kind::Message(part) | Kind::Many(part) => Some(*part),
            _ => None,
        })
    }

    /// `FileDescriptorProto`: name 1, package 2, dependency 3, message_type 4, syntax 12.
    fn file_descriptor(&self) -> Vec<u8> {
        let mut file = Wire::default();
        file.bytes(1, self.file.as_bytes());
        file.bytes(2, self.package.as_bytes());
        let mut needed: Vec<&str> = self.parts().map(|part| part.file).collect();
        needed.sort_unstable();
        needed.dedup();
        needed.iter().for_each(|name| file.bytes(3, name.as_bytes()));
        file.bytes(4, &self.descriptor());
        file.bytes(12, b"proto3");
        file.0
    }

    /// `DescriptorProto`: name 1, field 2, enum_type 4, oneof_decl 8.
    fn descriptor(&self) -> Vec<u8> {
        let mut message = Wire::default();
        message.bytes(1, self.name.as_bytes());
        let mut optional = Vec::new();
        for (name, number, kind) in self.fields {
            // An optional field stands alone in a choice between one.
            let choice = matches!(kind, Kind::OptionalDouble).then_some(optional.len() as u64);
            optional.extend(choice.map(|_| format!("_{name}")));
            message.bytes(2, &self.field_descriptor(name, *number, kind, choice));
        }
        for (.., kind) in self.fields {
            if let Kind::OneOf(name, values) = kind {
                message.bytes(4, &enum_descriptor(name, values));
            }
        }
        for name in optional {
            let mut choice = Wire::default();
            choice.bytes(1, name.as_bytes());
            message.bytes(8, &choice.0);
        }
        message.0
    }

    /// `FieldDescriptorProto`: name 1, number 3, label 4 (1 one, 3 many), type 5, type_name 6, oneof_index 9, proto3_optional 17.
    fn field_descriptor(&self, name: &str, number: u32, kind: &Kind, choice: Option<u64>) -> Vec<u8> {
        let (of, type_name) = match kind {
            Kind::Double | Kind::OptionalDouble | Kind::Doubles => (1, None),
            Kind::Int64 => (3, None),
            Kind::Int32 => (5, None),
            Kind::Fixed32 => (7, None),
            Kind::Text => (9, None),
            Kind::Message(part) | Kind::Many(part) => (11, Some(format!(".{}", part.full_name()))),
            Kind::Bytes => (12, None),
            Kind::OneOf(name, _) => (14, Some(format!(".{}.{name}", self.full_name()))),
        };
        let mut field = Wire::default();
        field.bytes(1, name.as_bytes());
        field.whole(3, u64::from(number));
        field.whole(4, if matches!(kind, Kind::Many(_) | Kind::Doubles) { 3 } else { 1 });
        field.whole(5, of);
        if let Some(type_name) = type_name {
            field.bytes(6, type_name.as_bytes());
        }
        if let Some(choice) = choice {
            field.whole(9, choice);
            field.whole(17, 1);
        }
        field.0
    }
}

/// `EnumDescriptorProto`: name 1, value 2; `EnumValueDescriptorProto`: name 1, number 2.
fn enum_descriptor(name: &str, values: &[&str]) -> Vec<u8> {
    let mut list = Wire::default();
    list.bytes(1, name.as_bytes());
    for (number, value) in values.iter().enumerate() {
        let mut entry = Wire::default();
        entry.bytes(1, value.as_bytes());
        entry.whole(2, number as u64);
        list.bytes(2, &entry.0);
    }
    list.0
}

/// A message that is being written.
#[derive(Default)]
struct Wire(Vec<u8>);

impl Wire {
    /// Seven bits in each byte, the low ones first; the eighth says that more follow.
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn key(&mut self, number: u32, wire_type: u64) -> &mut Self {
        self.varint(u64::from(number) << 3 | wire_type);
        self
    }

    fn whole(&mut self, number: u32, value: u64) {
        self.key(number, 0).varint(value);
    }

    fn bytes(&mut self, number: u32, bytes: &[u8]) {
        self.key(number, 2).varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INNER: MessageType =
        MessageType { package: "a", name: "Inner", file: "a/Inner.proto", fields: &[("n", 1, Kind::Int32)] };
    const OUTER: MessageType = MessageType {
        package: "a",
        name: "Outer",
        file: "a/Outer.proto",
        fields: &[("text", 2, Kind::Text), ("inner", 3, Kind::Message(&INNER))],
    };

    /// The examples of the documentation of the encoding.
    #[test]
    fn the_wire_is_as_documented() {
        assert_eq!(INNER.encode(&vec![("n", Content::Whole(150))]), [0x08, 0x96, 0x01]);
        let text = vec![("text", Content::Text("testing".to_owned()))];
        assert_eq!(OUTER.encode(&text), b"\x12\x07testing");
        let nested = vec![("inner", Content::Message(vec![("n", Content::Whole(150))]))];
        assert_eq!(OUTER.encode(&nested), [0x1a, 0x03, 0x08, 0x96, 0x01]);
    }

    #[test]
    #[should_panic(expected = "a.Inner has no field x")]
    fn an_unknown_field_is_a_bug() {
        INNER.encode(&vec![("x", Content::Whole(1))]);
    }
}
