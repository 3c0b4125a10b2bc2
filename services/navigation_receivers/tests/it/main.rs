//! Tests of the decoders from outside, in one program.

#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod corpus;
mod pieces;
mod published_libraries;
mod vectors;
