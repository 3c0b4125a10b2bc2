//! Flights judged and shown: the paper's figures again, reports as one page, drawings of logs.

pub mod info;
pub mod plot;
pub mod report;
pub mod reproduce;
pub mod text_table;
