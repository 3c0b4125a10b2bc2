//! How the chunks of a log are compressed.

use mcap::WriteOptions;

/// The compression of a log's chunks. The digest of a log does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Compression {
    /// Not at all: the least work.
    #[default]
    None,
    /// LZ4: about twice the work, less than half the size.
    Lz4,
    /// Zstandard: several times the work, the smallest files, by little.
    Zstd,
}

impl Compression {
    /// The one that MCAP, or `gerono run --compression`, calls so.
    pub(super) fn of_name(name: &str) -> Self {
        match name {
            "lz4" => Self::Lz4,
            "zstd" => Self::Zstd,
            _ => Self::None,
        }
    }

    /// The levels are fixed, because the library's default may move.
    pub(super) fn apply(self, options: WriteOptions) -> WriteOptions {
        match self {
            Self::None => options.compression(None),
            Self::Lz4 => options
                .compression(Some(mcap::Compression::Lz4))
                .compression_level(1),
            Self::Zstd => options
                .compression(Some(mcap::Compression::Zstd))
                .compression_level(3),
        }
    }
}
