//! The pages, with their content security policies.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use report::assets::{self, filled_in};
use sha2::{Digest, Sha256};

/// Template of the live page; `{{name}}` marks the place of a part.
const LIVE: &str = include_str!("assets/live.html");

/// Parts of the live page by mark.
const PARTS: [(&str, &str); 7] = [
    ("uplot.css", assets::UPLOT_STYLE),
    ("report.css", assets::STYLE),
    ("live.css", include_str!("assets/live.css")),
    ("uplot.js", assets::UPLOT),
    ("common.js", assets::COMMON),
    ("orbit.js", assets::ORBIT),
    ("live.js", include_str!("assets/live.js")),
];

/// Page as it is served.
#[derive(Clone, Debug)]
pub struct Page {
    pub html: String,
    /// Header `Content-Security-Policy`.
    pub policy: String,
}

impl Page {
    /// Creates a page.
    #[must_use]
    pub fn new(html: String) -> Self {
        let policy = policy_of(&html);
        Self { html, policy }
    }

    /// Returns the live page.
    ///
    /// # Panics
    /// Never: a test fills every mark.
    #[must_use]
    pub fn live() -> Self {
        Self::new(filled_in(LIVE, |name| {
            let part = PARTS.into_iter().find(|(part, _)| *part == name);
            part.unwrap_or_else(|| unreachable!("the page has no mark `{name}`"))
                .1
        }))
    }
}

/// Returns a policy that permits only the inline scripts and styles of this page, and connections only to this server.
fn policy_of(html: &str) -> String {
    format!(
        "default-src 'none'; script-src{}; style-src{}; img-src data:; connect-src 'self'; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'",
        hashes(html, "script"),
        hashes(html, "style")
    )
}

/// Returns the hashes of all elements of a name without attributes: data blocks have attributes and are not executed.
fn hashes(html: &str, element: &str) -> String {
    let (begin, end) = (format!("<{element}>"), format!("</{element}>"));
    let contents = html.split(&begin).skip(1);
    let hash = |content: &str| {
        let content = content.split(&end).next().unwrap_or_default();
        format!(" 'sha256-{}'", STANDARD.encode(Sha256::digest(content)))
    };
    contents.map(hash).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mark_of_the_page_has_a_part_and_every_part_a_mark() {
        let marks = LIVE
            .split("{{")
            .skip(1)
            .map(|piece| piece.split_once("}}").unwrap().0);
        let mut marks: Vec<_> = marks.collect();
        let mut parts: Vec<_> = PARTS.iter().map(|(name, _)| *name).collect();
        marks.sort_unstable();
        parts.sort_unstable();
        assert_eq!(marks, parts);
        for (name, text) in PARTS {
            assert!(!text.contains("</script") && !text.contains("</style"), "{name}");
        }
    }

    #[test]
    fn only_the_scripts_of_the_page_itself_are_permitted() {
        // The hash is that of the specification's example.
        let policy =
            Page::new("<style>a{}</style><script>alert('Hello, world.');</script>".to_owned()).policy;
        assert!(
            policy.contains("script-src 'sha256-qznLcsROx4GACP2dm0UCKCzCG+HiZ1guq6ZZDob/Tng=';"),
            "{policy}"
        );
        let live = Page::live().policy;
        assert_eq!(live.matches("'sha256-").count(), 7);
        assert!(!live.contains("unsafe"), "{live}");
    }
}
