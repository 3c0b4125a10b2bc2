//! Elementary functions with the same bits on every machine, for plug-ins and custom controllers.
//!
//! Those of a C library may differ in the last bit between machines. `+ − * / sqrt fabs floor rint` do not.

/// Declares the functions of one and of two arguments once: the table of the C interface, and lists by name.
macro_rules! functions {
    ($($unary:ident)+; $($binary:ident)+) => {
        /// `gerono_math`: the functions as a table for libraries in C.
        #[derive(Clone, Copy, Debug)]
        #[repr(C)]
        pub struct Math {
            $(#[doc = concat!("`", stringify!($unary), "(x)`")] pub $unary: extern "C" fn(f64) -> f64,)+
            $(#[doc = concat!("`", stringify!($binary), "(x, y)`")] pub $binary: extern "C" fn(f64, f64) -> f64,)+
        }

        /// The functions.
        pub static MATH: Math = {
            $(extern "C" fn $unary(x: f64) -> f64 { libm::$unary(x) })+
            $(extern "C" fn $binary(x: f64, y: f64) -> f64 { libm::$binary(x, y) })+
            Math { $($unary,)+ $($binary,)+ }
        };

        /// Functions of one argument by their names.
        pub const UNARY: &[(&str, fn(f64) -> f64)] = &[$((stringify!($unary), libm::$unary)),+];

        /// Functions of two arguments by their names.
        pub const BINARY: &[(&str, fn(f64, f64) -> f64)] = &[$((stringify!($binary), libm::$binary)),+];
    };
}

functions! {
    acos asin atan cbrt cos cosh exp expm1 log log10 log1p sin sinh tan tanh;
    atan2 hypot pow
}

#[cfg(test)]
mod tests {
    use super::{BINARY, UNARY};
    use crate::header;

    /// The header declares them in the same order, as the table has them in memory.
    #[test]
    fn the_header_has_the_same_functions() {
        let declared = header::TEXT
            .split("} gerono_math;")
            .next()
            .and_then(|before| before.rsplit("typedef struct {").next())
            .expect("the header declares gerono_math");
        let declared: Vec<&str> = declared
            .split("(*")
            .skip(1)
            .filter_map(|function| function.split(')').next())
            .collect();
        let unary = UNARY.iter().map(|(name, _)| *name);
        let all: Vec<&str> = unary.chain(BINARY.iter().map(|(name, _)| *name)).collect();
        assert_eq!(declared, all);
    }
}
