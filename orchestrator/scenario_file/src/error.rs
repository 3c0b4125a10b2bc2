//! Errors of scenario files, as a snippet for a terminal and as sentences for other output and logs.

use std::fmt::{Display, Formatter, Write};
use std::path::{Path, PathBuf};

use miette::{Diagnostic, LabeledSpan, SourceCode};

use super::snippet::Snippet;
use super::sources::Sources;
use crate::printable::printable;

/// Reason why a scenario is not flown. Displayed as one line, or with `{:#}` as one line per finding.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file could not be read.
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Reason why it could not be read.
        reason: String,
        /// The fix.
        fix: String,
    },
    /// The content of the file, or of the arguments, is wrong.
    Refused {
        /// The file.
        path: PathBuf,
        /// The findings; at least one.
        findings: Vec<Finding>,
    },
    /// A plug-in cannot be read, or its SHA-256 differs.
    Plugin(#[from] plugin::library_file::FileError),
}

/// Error in a scenario with its position. Displayed as its title, or with `{:#}` as one line with position, title, reason
/// and fix.
#[derive(Clone, Debug, thiserror::Error)]
pub struct Finding {
    pub(super) title: String,
    pub(super) reason: String,
    pub(super) fix: String,
    pub(super) snippet: Snippet,
    /// `true` if keys and types are valid, and the values cannot be flown.
    pub(super) is_of_values: bool,
}

impl ScenarioError {
    pub(super) fn refused(path: &Path, findings: Vec<Finding>) -> Self {
        Self::Refused {
            path: path.to_owned(),
            findings,
        }
    }

    /// Returns whether keys and types are valid, and only values cannot be flown.
    #[must_use]
    pub fn is_of_values(&self) -> bool {
        matches!(self, Self::Refused { findings, .. } if findings.iter().all(|finding| finding.is_of_values))
    }

    /// Names the settings as `name` instead of `--set`, for those that stand in a file.
    #[must_use]
    pub fn with_settings_named(mut self, name: &str) -> Self {
        if let Self::Refused { findings, .. } = &mut self {
            for finding in findings {
                finding.snippet.rename(Sources::ARGUMENT, &printable(name));
            }
        }
        self
    }

    /// Returns the error in one line without positions: each finding with its reason and fix.
    #[must_use]
    pub fn without_positions(&self) -> String {
        let Self::Refused { findings, .. } = self else {
            return format!("{self:#}");
        };
        let lines = findings.iter().map(|finding| {
            let Finding {
                title, reason, fix, ..
            } = finding;
            format!("{title}: {reason}; {fix}")
        });
        lines.collect::<Vec<_>>().join("; also ")
    }

    /// Returns the only finding of the error, if there is just one.
    fn only_finding(&self) -> Option<&Finding> {
        match self {
            Self::Refused { findings, .. } if findings.len() == 1 => findings.first(),
            _ => None,
        }
    }
}

impl Display for ScenarioError {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unreadable { path, reason, fix } => {
                let path = path.display().to_string();
                write!(
                    formatter,
                    "cannot read the scenario {}: {reason}",
                    printable(&path)
                )?;
                if formatter.alternate() {
                    write!(formatter, "; {fix}")?;
                }
                Ok(())
            }
            Self::Plugin(error) if formatter.alternate() => error.fmt(formatter),
            Self::Plugin(_) => formatter.write_str("a plug-in of the scenario cannot be used"),
            Self::Refused { findings, .. } if formatter.alternate() => {
                for (index, finding) in findings.iter().enumerate() {
                    let separator = if index == 0 { "" } else { "\n" };
                    write!(formatter, "{separator}{finding:#}")?;
                }
                Ok(())
            }
            Self::Refused { path, findings } => match findings.as_slice() {
                [finding] => Display::fmt(finding, formatter),
                _ => {
                    let path = path.display().to_string();
                    write!(formatter, "{} problems in {}", findings.len(), printable(&path))
                }
            },
        }
    }
}

impl Display for Finding {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        if formatter.alternate() {
            let (title, reason, fix) = (&self.title, &self.reason, &self.fix);
            write!(formatter, "{}: {title}: {reason}; {fix}", self.snippet.position())
        } else {
            formatter.write_str(&self.title)
        }
    }
}

impl Diagnostic for ScenarioError {
    fn help<'a>(&'a self) -> Option<Box<dyn Display + 'a>> {
        match self {
            Self::Unreadable { fix, .. } => Some(Box::new(fix)),
            Self::Plugin(_) => None,
            Self::Refused { .. } => self.only_finding()?.help(),
        }
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.only_finding()?.source_code()
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        self.only_finding()?.labels()
    }

    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn Diagnostic> + 'a>> {
        match self {
            Self::Refused { findings, .. } if findings.len() > 1 => Some(Box::new(
                findings.iter().map(|finding| finding as &dyn Diagnostic),
            )),
            _ => None,
        }
    }
}

impl Diagnostic for Finding {
    fn help<'a>(&'a self) -> Option<Box<dyn Display + 'a>> {
        Some(Box::new(&self.fix))
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        Some(&self.snippet)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let mut reason = self.reason.clone();
        if let Some(column) = self.snippet.true_column() {
            // Writing to a string does not fail.
            let _ = write!(reason, " (column {column} of a long line)");
        }
        let label = LabeledSpan::new_with_span(Some(reason), self.snippet.span());
        Some(Box::new(std::iter::once(label)))
    }
}
