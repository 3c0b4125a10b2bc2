//! Layouts of samples in logs of earlier versions.
//!
//! A new member may use bytes that were padding: then the samples of earlier logs have the size and the members that they
//! have now, and that member is zero in all of them.

use std::mem::offset_of;
use std::ops::Range;

use crate::Topic;
use crate::samples::PathReference;

/// Earlier layout of a topic's samples.
struct EarlierLayout {
    topic: Topic,
    hash: &'static str,
    /// Bytes that were padding and belong to a member now.
    padding: Range<usize>,
}

const EARLIER_LAYOUTS: [EarlierLayout; 1] = [
    // Until the evening of 2026-11-25 a reference had no cause.
    EarlierLayout {
        topic: Topic::PathReference,
        hash: "d1bf73622e0a7c719d576dc2f73d1130",
        padding: offset_of!(PathReference, cause)..offset_of!(PathReference, cause) + 1,
    },
];

impl Topic {
    /// Returns the bytes that are a member's now and were padding in the layout with this hash: none in the current layout.
    /// `None` for an unknown layout.
    #[must_use]
    pub fn padding_in(self, layout_hash: &str) -> Option<Range<usize>> {
        if layout_hash == self.layout_hash() {
            return Some(0..0);
        }
        let mut earlier = EARLIER_LAYOUTS.iter();
        let found = earlier.find(|layout| layout.topic == self && layout.hash == layout_hash)?;
        Some(found.padding.clone())
    }
}
