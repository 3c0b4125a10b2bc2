//! Why a scenario is not flown, for people with a terminal (a snippet), without one (sentences), and in logs.

use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode, SourceSpan};

/// Why a scenario is not flown. Displayed as one line, or as one line a finding with `{:#}`.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file could not be read.
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why it could not be read.
        reason: String,
        /// What to do about it.
        fix: String,
    },
    /// What is in the file, or in the arguments, is wrong.
    Refused {
        /// The file.
        path: PathBuf,
        /// What is wrong; at least one thing.
        findings: Vec<Finding>,
    },
}

/// One thing that is wrong with a scenario, and where. Displayed as its title; with `{:#}` as one line that
/// says all: place, title, reason and fix.
#[derive(Clone, Debug, thiserror::Error)]
pub struct Finding {
    pub(super) title: String,
    pub(super) reason: String,
    pub(super) fix: String,
    pub(super) source_code: Arc<NamedSource<String>>,
    pub(super) span: SourceSpan,
}

impl ScenarioError {
    pub(super) fn refused(path: &Path, findings: Vec<Finding>) -> Self {
        Self::Refused {
            path: path.to_owned(),
            findings,
        }
    }

    /// The finding that is the whole error, if there is one.
    fn only_finding(&self) -> Option<&Finding> {
        match self {
            Self::Refused { findings, .. } if findings.len() == 1 => findings.first(),
            _ => None,
        }
    }
}

impl Finding {
    /// Where it is: name of the file or argument, line, and column in characters.
    fn place(&self) -> String {
        let before = &self.source_code.inner()[..self.span.offset()];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = before.matches('\n').count() + 1;
        let column = before[line_start..].chars().count() + 1;
        format!("{}:{line}:{column}", self.source_code.name())
    }
}

impl Display for ScenarioError {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unreadable { path, reason, fix } => {
                write!(formatter, "cannot read the scenario {}: {reason}", path.display())?;
                if formatter.alternate() {
                    write!(formatter, "; {fix}")?;
                }
                Ok(())
            }
            Self::Refused { findings, .. } if formatter.alternate() => {
                for (index, finding) in findings.iter().enumerate() {
                    let separator = if index == 0 { "" } else { "\n" };
                    write!(formatter, "{separator}{finding:#}")?;
                }
                Ok(())
            }
            Self::Refused { path, findings } => match findings.as_slice() {
                [finding] => Display::fmt(finding, formatter),
                _ => write!(formatter, "{} problems in {}", findings.len(), path.display()),
            },
        }
    }
}

impl Display for Finding {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        if formatter.alternate() {
            let (title, reason, fix) = (&self.title, &self.reason, &self.fix);
            write!(formatter, "{}: {title}: {reason}; {fix}", self.place())
        } else {
            formatter.write_str(&self.title)
        }
    }
}

impl Diagnostic for ScenarioError {
    fn help<'a>(&'a self) -> Option<Box<dyn Display + 'a>> {
        match self {
            Self::Unreadable { fix, .. } => Some(Box::new(fix)),
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
        Some(&*self.source_code)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let label = LabeledSpan::new_with_span(Some(self.reason.clone()), self.span);
        Some(Box::new(std::iter::once(label)))
    }
}
