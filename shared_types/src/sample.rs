//! Samples: fixed-size records whose bytes in shared memory are the bytes in the log.
//!
//! [`sample!`](crate::sample!) declares a record once and yields
//! * a `#[repr(C)]` struct of plain numbers without implicit padding (the derive of
//!   [`zerocopy::IntoBytes`] is the compile-time proof),
//! * the text of its ROS 2 message definition ([`Record::MSG_NAME`], [`msg_definition`]), with which every tool that
//!   reads CDR decodes these bytes,
//! * its layout hash ([`layout_hash`]), in which all processes that open a topic must agree,
//! * the check that every number in it is finite ([`Field::is_finite`]).
//!
//! A little-endian `repr(C)` struct without implicit padding is byte for byte an XCDR1 payload. For that reason only
//! types that implement [`Field`] may be members.

use std::ops::Range;

use sha2::{Digest, Sha256};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

/// Package name under which the message definitions appear in logs.
pub const MSG_PACKAGE: &str = "gerono_msgs";

/// Header before a sample's bytes in a logged message: CDR as of XCDR1, little-endian, no options.
pub const CDR_HEADER: [u8; 4] = [0, 1, 0, 0];

/// Form of a field type in a message definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MsgType {
    /// Name of the element type, such as `float64` or `gerono_msgs/Header`.
    pub element: String,
    /// Length of a fixed array, or `None` for a single value.
    pub length: Option<usize>,
    /// Definitions of the nested record types that the element needs, outermost first.
    pub nested: Vec<(&'static str, String)>,
}

/// Type that may be a member of a sample: a number, a fixed array of numbers, or another record.
pub trait Field: Copy + FromBytes + IntoBytes + Immutable + KnownLayout + 'static {
    /// Returns the type's form in a message definition.
    fn msg_type() -> MsgType;

    /// Returns whether every floating-point number in the value is finite.
    fn is_finite(&self) -> bool;

    /// Returns whether every floating-point number in the value has at most this magnitude, and so is finite.
    fn is_within(&self, magnitude: f64) -> bool;
}

macro_rules! primitive_field {
    ($($rust:ty => $msg:literal, |$value:ident| $finite:expr, |$bounded:ident, $bound:ident| $within:expr;)*) => {$(
        impl Field for $rust {
            fn msg_type() -> MsgType {
                MsgType { element: $msg.to_owned(), length: None, nested: Vec::new() }
            }

            #[inline]
            fn is_finite(&self) -> bool {
                let $value = *self;
                $finite
            }

            #[inline]
            fn is_within(&self, magnitude: f64) -> bool {
                let ($bounded, $bound) = (*self, magnitude);
                $within
            }
        }
    )*};
}

primitive_field! {
    u8 => "uint8", |_x| true, |_x, _bound| true;
    u16 => "uint16", |_x| true, |_x, _bound| true;
    u32 => "uint32", |_x| true, |_x, _bound| true;
    u64 => "uint64", |_x| true, |_x, _bound| true;
    i64 => "int64", |_x| true, |_x, _bound| true;
    f32 => "float32", |x| x.is_finite(), |x, bound| f64::from(x).abs() <= bound;
    f64 => "float64", |x| x.is_finite(), |x, bound| x.abs() <= bound;
}

impl<T: Field, const N: usize> Field for [T; N] {
    fn msg_type() -> MsgType {
        let element = T::msg_type();
        assert!(
            element.length.is_none(),
            "a message definition cannot nest arrays"
        );
        MsgType {
            length: Some(N),
            ..element
        }
    }

    #[inline]
    fn is_finite(&self) -> bool {
        // Without short-circuit, so that the compiler may vectorise.
        self.iter().fold(true, |all, element| all & element.is_finite())
    }

    #[inline]
    fn is_within(&self, magnitude: f64) -> bool {
        self.iter()
            .fold(true, |all, element| all & element.is_within(magnitude))
    }
}

/// Truth value as one byte: 0 is false, everything else is true, so that any bit pattern is valid.
#[derive(Clone, Copy, Default, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(transparent)]
pub struct Flag(u8);

impl Flag {
    /// The flag that is not set.
    pub const CLEAR: Self = Self(0);

    /// Returns whether the flag is set.
    #[must_use]
    pub fn is_set(self) -> bool {
        self.0 != 0
    }
}

impl From<bool> for Flag {
    fn from(value: bool) -> Self {
        Self(u8::from(value))
    }
}

impl PartialEq for Flag {
    fn eq(&self, other: &Self) -> bool {
        self.is_set() == other.is_set()
    }
}

impl std::fmt::Debug for Flag {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.is_set().fmt(formatter)
    }
}

impl Field for Flag {
    fn msg_type() -> MsgType {
        MsgType {
            element: "bool".to_owned(),
            length: None,
            nested: Vec::new(),
        }
    }

    #[inline]
    fn is_finite(&self) -> bool {
        true
    }

    #[inline]
    fn is_within(&self, _magnitude: f64) -> bool {
        true
    }
}

/// Offset and type of a member of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Name in the message definition.
    pub name: &'static str,
    /// Offset of its first byte.
    pub offset: usize,
    /// Name of the element type, such as `float64`.
    pub element: String,
    /// Number of its elements; `None` for a single value.
    pub length: Option<usize>,
    /// What it is: symbol, frame, unit.
    pub meaning: &'static str,
}

impl Member {
    /// Returns whether it holds floating-point numbers.
    #[must_use]
    pub fn is_number(&self) -> bool {
        self.element == "float64"
    }

    /// Returns the bytes of its floating-point numbers, each 8 bytes; of one of them, if `index` is given.
    #[must_use]
    pub fn numbers(&self, index: Option<usize>) -> Option<Range<usize>> {
        let length = self.length.unwrap_or(1);
        let (first, count) = match index {
            None => (0, length),
            Some(index) if self.length.is_some() && index < length => (index, 1),
            Some(_) => return None,
        };
        let begin = self.offset + first * size_of::<f64>();
        self.is_number().then(|| begin..begin + count * size_of::<f64>())
    }
}

impl std::fmt::Display for Member {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.length {
            None => write!(formatter, "`{}`", self.name),
            Some(length) => write!(formatter, "`{}` (.0 to .{})", self.name, length - 1),
        }
    }
}

/// Record declared by [`sample!`](crate::sample!).
pub trait Record: Field {
    /// Name of the type on the wire and in the log, for example `gerono_msgs/msg/VehicleState`.
    const MSG_NAME: &'static str;

    /// Returns its members, in their order.
    fn members() -> Vec<Member>;

    /// Returns one line per member: `type name`, with the constants above their field.
    fn msg_body() -> String;

    /// Returns the name of the first member that holds a number that is not finite.
    fn first_non_finite_field(&self) -> Option<&'static str>;
}

/// First members of every sample that travels on a topic.
///
/// Process ids, incarnations and wall-clock facts never enter it.
pub trait Sample: Record {
    /// Returns the common header.
    fn header(&self) -> &Header;

    /// Returns the common header, to be filled by the host before the step.
    fn header_mut(&mut self) -> &mut Header;
}

/// Returns the whole message definition of a record: its members, then the definitions that they need.
#[must_use]
pub fn msg_definition<R: Record>() -> String {
    let mut text = R::msg_body();
    let mut written: Vec<&str> = Vec::new();
    for (name, body) in R::msg_type().nested.iter().skip(1) {
        if !written.contains(name) {
            written.push(name);
            text.push_str(&"=".repeat(80));
            text.push_str(&format!("\nMSG: {}\n{body}", name.replace("/msg/", "/")));
        }
    }
    text
}

/// Returns the hash of a record's layout: its name, and its members' names, types and order.
///
/// Two processes exchange a sample only if their hashes agree; iceoryx2 alone compares name, size and alignment.
#[must_use]
pub fn layout_hash<R: Record>() -> String {
    let text = format!("{}\n{}", R::MSG_NAME, msg_definition::<R>());
    hex(&Sha256::digest(text.as_bytes())[..16])
}

/// Returns bytes in lower-case hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns one line of a message definition.
#[doc(hidden)]
#[must_use]
pub fn msg_line<F: Field>(name: &str) -> String {
    let MsgType { element, length, .. } = F::msg_type();
    match length {
        Some(length) => format!("{element}[{length}] {name}\n"),
        None => format!("{element} {name}\n"),
    }
}

/// Declares records: struct, message definition, layout proof and finiteness check at once.
///
/// ```
/// shared_types::sample! {
///     /// A point and how it was found.
///     pub struct Fix {
///         /// Position in {I}, m.
///         pub position_world: [f64; 3],
///         #[values(SOURCE_NONE = 0, SOURCE_OPTICAL = 1)]
///         /// Where the fix comes from.
///         pub source: u32,
///         /// Explicit padding: a record has no other.
///         pub pad0: u32,
///     }
/// }
/// use shared_types::sample::{Record, msg_definition};
/// assert_eq!(Fix::MSG_NAME, "gerono_msgs/msg/Fix");
/// assert_eq!(
///     msg_definition::<Fix>(),
///     "float64[3] position_world\nuint32 SOURCE_NONE=0\nuint32 SOURCE_OPTICAL=1\nuint32 source\nuint32 pad0\n",
/// );
/// assert_eq!(Fix::SOURCE_OPTICAL, 1);
/// ```
///
/// Implicit padding does not compile:
///
/// ```compile_fail
/// shared_types::sample! {
///     /// Four bytes are missing after `first`.
///     pub struct Padded {
///         /// One.
///         pub first: u32,
///         /// Two.
///         pub second: u64,
///     }
/// }
/// ```
#[macro_export]
macro_rules! sample {
    ($(
        $(#[doc = $doc:literal])*
        pub struct $name:ident {$(
            $(#[values($($constant:ident = $value:literal),+ $(,)?)])?
            $(#[doc = $field_doc:literal])*
            pub $field:ident: $type:ty
        ),+ $(,)?}
    )+) => {$(
        $(#[doc = $doc])*
        #[derive(
            Clone, Copy, Debug, PartialEq,
            ::zerocopy::FromBytes, ::zerocopy::IntoBytes, ::zerocopy::Immutable, ::zerocopy::KnownLayout,
        )]
        #[repr(C)]
        pub struct $name {$(
            $(#[doc = $field_doc])*
            pub $field: $type,
        )+}

        impl $name {$($($(
            #[doc = concat!("A value of [`", stringify!($field), "`](Self::", stringify!($field), ").")]
            pub const $constant: $type = $value;
        )+)?)+}

        impl $crate::sample::Field for $name {
            fn msg_type() -> $crate::sample::MsgType {
                let mut nested = vec![(
                    <$name as $crate::sample::Record>::MSG_NAME,
                    <$name as $crate::sample::Record>::msg_body(),
                )];
                $(nested.extend(<$type as $crate::sample::Field>::msg_type().nested);)+
                $crate::sample::MsgType {
                    element: format!("{}/{}", $crate::sample::MSG_PACKAGE, stringify!($name)),
                    length: None,
                    nested,
                }
            }

            #[inline]
            fn is_finite(&self) -> bool {
                true $(& $crate::sample::Field::is_finite(&self.$field))+
            }

            #[inline]
            fn is_within(&self, magnitude: f64) -> bool {
                true $(& $crate::sample::Field::is_within(&self.$field, magnitude))+
            }
        }

        impl $crate::sample::Record for $name {
            const MSG_NAME: &'static str = concat!("gerono_msgs/msg/", stringify!($name));

            fn members() -> Vec<$crate::sample::Member> {
                vec![$({
                    let $crate::sample::MsgType { element, length, .. } =
                        <$type as $crate::sample::Field>::msg_type();
                    $crate::sample::Member {
                        name: stringify!($field),
                        offset: ::core::mem::offset_of!($name, $field),
                        element,
                        length,
                        meaning: concat!($($field_doc),*).trim(),
                    }
                }),+]
            }

            fn msg_body() -> String {
                let mut text = String::new();
                $(
                    $($(text.push_str(&format!(
                        "{} {}={}\n",
                        <$type as $crate::sample::Field>::msg_type().element,
                        stringify!($constant),
                        $value,
                    ));)+)?
                    text.push_str(&$crate::sample::msg_line::<$type>(stringify!($field)));
                )+
                text
            }

            fn first_non_finite_field(&self) -> Option<&'static str> {
                $(if !$crate::sample::Field::is_finite(&self.$field) {
                    return Some(stringify!($field));
                })+
                None
            }
        }
    )+};
}

sample! {
    /// Common header of all samples.
    pub struct Header {
        /// Base tick at which the sample was published.
        pub tick: u64,
        /// Time of that tick since the start of the flight, ns.
        pub stamp_ns: u64,
        /// Number of the sample on its topic, from 0; in lock-step a function of the schedule.
        pub seq: u64,
    }
}

// External services, and readers of logs of any build, expect it at these offsets.
const _: () = assert!(
    size_of::<Header>() == 24
        && std::mem::offset_of!(Header, tick) == 0
        && std::mem::offset_of!(Header, stamp_ns) == 8
        && std::mem::offset_of!(Header, seq) == 16
);

#[cfg(test)]
mod tests {
    use super::*;

    sample! {
        /// Exercises nesting and arrays of records.
        pub struct Nested {
            /// Common header.
            pub header: Header,
            /// Earlier headers.
            pub earlier: [Header; 2],
            /// A value.
            pub value: f64,
            /// A flag.
            pub raised: Flag,
            /// Padding.
            pub pad0: [u8; 7],
        }
    }

    fn zero() -> Nested {
        <Nested as zerocopy::FromZeros>::new_zeroed()
    }

    #[test]
    fn nested_definitions_are_written_once_under_a_ruler() {
        let ruler = "=".repeat(80);
        assert_eq!(
            msg_definition::<Nested>(),
            format!(
                "gerono_msgs/Header header\ngerono_msgs/Header[2] earlier\nfloat64 value\nbool raised\n\
                 uint8[7] pad0\n{ruler}\nMSG: gerono_msgs/Header\nuint64 tick\nuint64 stamp_ns\nuint64 seq\n"
            )
        );
    }

    #[test]
    fn size_is_the_sum_of_the_members() {
        assert_eq!(size_of::<Nested>(), 3 * 24 + 8 + 1 + 7);
    }

    #[test]
    fn numbers_are_found_where_they_are() {
        let members = Nested::members();
        let named = |name| members.iter().find(|member| member.name == name).unwrap();
        assert_eq!(named("value").numbers(None), Some(72..80));
        assert_eq!(named("value").numbers(Some(0)), None);
        assert_eq!(named("raised").numbers(None), None);
        assert_eq!(named("header").numbers(None), None);
        let position = Member {
            name: "position",
            offset: 24,
            element: "float64".to_owned(),
            length: Some(3),
            meaning: "",
        };
        assert_eq!(position.numbers(None), Some(24..48));
        assert_eq!(position.numbers(Some(2)), Some(40..48));
        assert_eq!(position.numbers(Some(3)), None);
    }

    #[test]
    fn the_first_non_finite_member_is_named() {
        let mut sample = zero();
        assert_eq!(sample.first_non_finite_field(), None);
        sample.value = f64::NAN;
        assert!(!sample.is_finite());
        assert_eq!(sample.first_non_finite_field(), Some("value"));
    }

    #[test]
    fn the_layout_hash_sees_names_types_and_order() {
        mod swapped {
            crate::sample! {
                /// Same size as the other, members swapped.
                pub struct Pair {
                    /// Second first.
                    pub b: u64,
                    /// First second.
                    pub a: u64,
                }
            }
        }
        sample! {
            /// Same name and size as the other.
            pub struct Pair {
                /// First.
                pub a: u64,
                /// Second.
                pub b: u64,
            }
        }
        assert_eq!(Pair::MSG_NAME, swapped::Pair::MSG_NAME);
        assert_ne!(layout_hash::<Pair>(), layout_hash::<swapped::Pair>());
    }
}
