//! Compression of a log's chunks.

use mcap::WriteOptions;

/// Compression of a log's chunks. The digest of a log does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    /// All compressions, with their names on the command line and their costs.
    pub const ALL: [(Self, &'static str, &'static str); 3] = [
        (Self::None, "none", "Not at all: the least work"),
        (
            Self::Lz4,
            "lz4",
            "LZ4: about twice the work, less than half the size",
        ),
        (
            Self::Zstd,
            "zstd",
            "Zstandard: several times the work, the smallest files, by little",
        ),
    ];

    /// Returns the compression with a name of MCAP or of the command line; none for an unknown name.
    #[must_use]
    pub fn of_name(name: &str) -> Self {
        let found = Self::ALL.into_iter().find(|(_, known, _)| *known == name);
        found.map_or(Self::None, |(compression, ..)| compression)
    }

    /// Sets the compression. The levels are fixed, because the library's defaults may change.
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
