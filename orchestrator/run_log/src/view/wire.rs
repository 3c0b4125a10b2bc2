//! Protocol Buffers as far as messages for viewers need them: the bytes of a message, and the description of its type.
//!
//! All members are written, zeros too: some readers take what is missing for unknown.

/// What a member is, numbered as in `FieldDescriptorProto.Type`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Double = 1,
    Int64 = 3,
    Int32 = 5,
    Fixed32 = 7,
    Bool = 8,
    Text = 9,
    Message = 11,
    Bytes = 12,
    Enumeration = 14,
}

/// How many bytes of a member follow its number.
#[derive(Clone, Copy)]
enum Length {
    Variable = 0,
    Eight = 1,
    Stated = 2,
    Four = 5,
}

/// Something that can be a member of a message.
pub(super) trait Value {
    /// What it is.
    const KIND: Kind;
    /// Whether there may be any number of it.
    const IS_REPEATED: bool = false;

    /// The full name of its type, of messages and enumerations.
    fn type_name() -> Option<String> {
        None
    }

    /// Appends it as the member of this number.
    fn write(&self, number: u32, out: &mut Vec<u8>);
}

/// A member as a description has it.
pub(super) struct Member {
    pub(super) name: &'static str,
    pub(super) number: u32,
    pub(super) kind: Kind,
    pub(super) is_repeated: bool,
    pub(super) type_name: Option<String>,
}

impl Member {
    pub(super) fn of<V: Value>(name: &'static str, number: u32) -> Self {
        Self {
            // A word that Rust has a use for is written `r#type` there.
            name: name.trim_start_matches("r#"),
            number,
            kind: V::KIND,
            is_repeated: V::IS_REPEATED,
            type_name: V::type_name(),
        }
    }
}

/// A message.
pub(super) trait Message {
    /// Its full name, package first.
    const NAME: &'static str;

    /// Its members.
    fn members() -> Vec<Member>;

    /// Its bytes.
    fn encode(&self) -> Vec<u8>;
}

/// The types of a package.
pub(super) struct Package {
    pub(super) name: &'static str,
    /// The file that they seem to stand in.
    pub(super) file: &'static str,
    /// The files of types that they use.
    pub(super) imports: &'static [&'static str],
    /// Messages by their full names.
    pub(super) messages: Vec<(&'static str, Vec<Member>)>,
    /// Enumerations by their names, with their values from 0 on.
    pub(super) enumerations: &'static [(&'static str, &'static [&'static str])],
}

/// Declares messages of a package, with the numbers of their members: structures that encode themselves, and a function of this
/// name that describes all of them.
macro_rules! messages {
    (
        fn $all:ident, $package:literal
        $(
            $(#[$attribute:meta])*
            $name:ident { $( $(#[$of_member:meta])* $number:literal $member:ident: $type:ty ),* $(,)? }
        )*
    ) => {
        $(
            $(#[$attribute])*
            #[derive(Clone, Debug, PartialEq)]
            pub(super) struct $name { $( $(#[$of_member])* pub(super) $member: $type ),* }

            impl Message for $name {
                const NAME: &'static str = concat!($package, ".", stringify!($name));

                fn members() -> Vec<Member> {
                    vec![$( Member::of::<$type>(stringify!($member), $number) ),*]
                }

                fn encode(&self) -> Vec<u8> {
                    let mut out = Vec::new();
                    $( self.$member.write($number, &mut out); )*
                    out
                }
            }
        )*

        fn $all() -> Vec<(&'static str, Vec<Member>)> {
            vec![$( (<$name as Message>::NAME, <$name as Message>::members()) ),*]
        }
    };
}
pub(super) use messages;

impl Value for f64 {
    const KIND: Kind = Kind::Double;

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_tag(number, Length::Eight, out);
        out.extend_from_slice(&self.to_le_bytes());
    }
}

impl Value for i64 {
    const KIND: Kind = Kind::Int64;

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_tag(number, Length::Variable, out);
        write_varint(self.cast_unsigned(), out);
    }
}

impl Value for i32 {
    const KIND: Kind = Kind::Int32;

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_tag(number, Length::Variable, out);
        write_varint(i64::from(*self).cast_unsigned(), out);
    }
}

impl Value for u32 {
    const KIND: Kind = Kind::Fixed32;

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_tag(number, Length::Four, out);
        out.extend_from_slice(&self.to_le_bytes());
    }
}

impl Value for bool {
    const KIND: Kind = Kind::Bool;

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_tag(number, Length::Variable, out);
        write_varint(u64::from(*self), out);
    }
}

impl Value for &'static str {
    const KIND: Kind = Kind::Text;

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_bytes(number, self.as_bytes(), out);
    }
}

impl Value for Vec<u8> {
    const KIND: Kind = Kind::Bytes;

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_bytes(number, self, out);
    }
}

impl<M: Message> Value for M {
    const KIND: Kind = Kind::Message;

    fn type_name() -> Option<String> {
        Some(format!(".{}", M::NAME))
    }

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        write_bytes(number, &self.encode(), out);
    }
}

impl<M: Message> Value for Vec<M> {
    const KIND: Kind = Kind::Message;
    const IS_REPEATED: bool = true;

    fn type_name() -> Option<String> {
        M::type_name()
    }

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        self.iter().for_each(|message| message.write(number, out));
    }
}

fn write_tag(number: u32, length: Length, out: &mut Vec<u8>) {
    write_varint(u64::from(number) << 3 | length as u64, out);
}

fn write_varint(mut value: u64, out: &mut Vec<u8>) {
    const MORE: u8 = 0x80;
    while value >= u64::from(MORE) {
        out.push(value as u8 | MORE);
        value >>= 7;
    }
    out.push(value as u8);
}

fn write_bytes(number: u32, bytes: &[u8], out: &mut Vec<u8>) {
    write_tag(number, Length::Stated, out);
    write_varint(bytes.len() as u64, out);
    out.extend_from_slice(bytes);
}

/// The packages as a schema of MCAP describes them: a `FileDescriptorSet`, in which packages precede those that use them.
pub(super) fn describe(packages: &[Package]) -> Vec<u8> {
    let mut set = Vec::new();
    for package in packages {
        write_bytes(1, &file(package), &mut set);
    }
    set
}

/// A `FileDescriptorProto`.
fn file(package: &Package) -> Vec<u8> {
    let mut out = Vec::new();
    write_bytes(1, package.file.as_bytes(), &mut out);
    write_bytes(2, package.name.as_bytes(), &mut out);
    for import in package.imports {
        write_bytes(3, import.as_bytes(), &mut out);
    }
    for (name, members) in &package.messages {
        write_bytes(4, &message(name, members), &mut out);
    }
    for (name, values) in package.enumerations {
        write_bytes(5, &enumeration(name, values), &mut out);
    }
    write_bytes(12, b"proto3", &mut out);
    out
}

/// A `DescriptorProto`.
fn message(name: &str, members: &[Member]) -> Vec<u8> {
    let mut out = Vec::new();
    let (_, own_name) = name.rsplit_once('.').unwrap_or_default();
    write_bytes(1, own_name.as_bytes(), &mut out);
    for member in members {
        write_bytes(2, &description(member), &mut out);
    }
    out
}

/// A `FieldDescriptorProto`.
fn description(member: &Member) -> Vec<u8> {
    const ONE: i32 = 1;
    const ANY_NUMBER: i32 = 3;
    let mut out = Vec::new();
    write_bytes(1, member.name.as_bytes(), &mut out);
    member.number.cast_signed().write(3, &mut out);
    let label = if member.is_repeated { ANY_NUMBER } else { ONE };
    label.write(4, &mut out);
    (member.kind as i32).write(5, &mut out);
    if let Some(type_name) = &member.type_name {
        write_bytes(6, type_name.as_bytes(), &mut out);
    }
    out
}

/// An `EnumDescriptorProto`.
fn enumeration(name: &str, values: &[&str]) -> Vec<u8> {
    let mut out = Vec::new();
    write_bytes(1, name.as_bytes(), &mut out);
    for (number, value) in (0_i32..).zip(values) {
        let mut description = Vec::new();
        write_bytes(1, value.as_bytes(), &mut description);
        number.write(2, &mut description);
        write_bytes(2, &description, &mut out);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    messages! {
        fn all, "test"

        /// A message within another.
        Inner {
            1 value: i32,
        }

        /// One with all that there is.
        Outer {
            1 number: f64,
            2 whole: i64,
            3 count: u32,
            4 raised: bool,
            5 text: &'static str,
            6 bytes: Vec<u8>,
            7 inner: Inner,
            20 r#type: Vec<Inner>,
        }
    }

    #[test]
    fn a_message_has_the_bytes_that_the_format_prescribes() {
        let outer = Outer {
            number: 1.0,
            whole: 300,
            count: 7,
            raised: false,
            text: "ab",
            bytes: vec![255],
            inner: Inner { value: -1 },
            r#type: vec![Inner { value: 1 }, Inner { value: 2 }],
        };
        let minus_one = [8, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1];
        let expected = [
            &[9, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f][..],
            &[16, 0xac, 2],
            &[29, 7, 0, 0, 0],
            &[32, 0],
            &[42, 2, b'a', b'b'],
            &[50, 1, 255],
            &[58, 11],
            &minus_one,
            &[0xa2, 1, 2, 8, 1],
            &[0xa2, 1, 2, 8, 2],
        ];
        assert_eq!(outer.encode(), expected.concat());
    }

    #[test]
    fn a_description_names_types_in_full_and_members_as_they_are() {
        let members = Outer::members();
        let last = members.last().unwrap();
        assert_eq!((last.name, last.number, last.is_repeated), ("type", 20, true));
        assert_eq!(last.type_name.as_deref(), Some(".test.Inner"));
        assert_eq!(members[0].type_name, None);
        let names: Vec<_> = all().into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["test.Inner", "test.Outer"]);
        assert_eq!(
            message("test.Inner", &Inner::members()),
            b"\x0a\x05Inner\x12\x0d\x0a\x05value\x18\x01 \x01(\x05"
        );
    }
}
