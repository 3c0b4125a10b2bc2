//! A table of results, rendered for a terminal, as Markdown, as HTML or as LaTeX.

use std::fmt::{self, Display, Formatter};

use comfy_table::{Table, presets};

/// A table of results.
#[derive(Clone, Debug, PartialEq)]
pub struct TextTable {
    /// Quantity, with units; may be empty.
    pub title: String,
    /// Names of the columns; an explanation may follow after a line feed.
    pub header: Vec<String>,
    /// Cells of each row.
    pub lines: Vec<Vec<String>>,
}

impl TextTable {
    /// Makes a table.
    #[must_use]
    pub fn new<T: ToString>(title: &str, header: &[T], lines: impl IntoIterator<Item = Vec<String>>) -> Self {
        Self {
            title: title.to_owned(),
            header: header.iter().map(T::to_string).collect(),
            lines: lines.into_iter().collect(),
        }
    }

    /// Renders the table as Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| {
            let cells: Vec<_> = cells.iter().map(|cell| cell.replace('\n', ": ")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let title = match self.title.as_str() {
            "" => String::new(),
            title => format!("{title}:\n\n"),
        };
        let rule = format!("|{}\n", " --- |".repeat(self.header.len()));
        let lines: String = self.lines.iter().map(|cells| line(cells)).collect();
        title + &line(&self.header) + &rule + &lines
    }

    /// Renders the table as HTML with a heading.
    #[must_use]
    pub fn html(&self) -> String {
        let line = |tag: &str, cells: &[String]| {
            let cells = cells
                .iter()
                .map(|cell| format!("<{tag}>{}</{tag}>", code_marked(&escaped(cell))));
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        };
        let lines: String = self.lines.iter().map(|cells| line("td", cells)).collect();
        format!(
            "<h2>{}</h2>\n<div class=\"wide\"><table>\n{}{lines}</table></div>\n",
            escaped(&self.title),
            line("th", &self.header)
        )
    }

    /// Renders the table as a LaTeX `table` with the rules of the package `booktabs`, numbers right-aligned.
    #[must_use]
    pub fn latex(&self) -> String {
        let line = |cells: &[String]| {
            let cells: Vec<_> = cells
                .iter()
                .map(|cell| latex(&cell.replace('\n', ": ")))
                .collect();
            format!("    {} \\\\\n", cells.join(" & "))
        };
        let is_number = |column: usize| {
            let mut cells = self.lines.iter().map(|cells| cells[column].as_str());
            cells.all(|cell| {
                cell.starts_with(|first: char| first.is_ascii_digit() || "+-−–<≥".contains(first))
            })
        };
        let columns: String = (0..self.header.len())
            .map(|column| if is_number(column) { 'r' } else { 'l' })
            .collect();
        let lines: String = self.lines.iter().map(|cells| line(cells)).collect();
        format!(
            "\\begin{{table}}\n  \\centering\n  \\caption{{{}}}\n  \\begin{{tabular}}{{{columns}}}\n    \\toprule\n{}    \
             \\midrule\n{lines}    \\bottomrule\n  \\end{{tabular}}\n\\end{{table}}\n",
            latex(&self.title),
            line(&self.header)
        )
    }
}

/// Renders the table for a terminal.
impl Display for TextTable {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_header(&self.header);
        table.add_rows(&self.lines);
        if !self.title.is_empty() {
            writeln!(formatter, "{}", self.title)?;
        }
        write!(formatter, "{table}")
    }
}

/// Returns tables as a LaTeX file to include; a comment at its head states the required package.
#[must_use]
pub fn latex_file(tables: &[TextTable]) -> String {
    let head = "% Written by gerono. In the preamble: \\usepackage{booktabs}\n";
    let tables: Vec<String> = tables.iter().map(TextTable::latex).collect();
    format!("{head}{}", tables.join("\n"))
}

/// Replaces backticks by `<code>` tags.
fn code_marked(text: &str) -> String {
    let mut parts = text.split('`');
    let first = parts.next().unwrap_or_default().to_owned();
    let tags = ["<code>", "</code>"].into_iter().cycle();
    parts
        .zip(tags)
        .fold(first, |marked, (part, tag)| marked + tag + part)
}

/// Escapes text for any LaTeX engine: non-ASCII characters that occur in tables become commands.
fn latex(text: &str) -> String {
    let mut written = String::new();
    let mut is_code = false;
    let mut before = ' ';
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        let is_minus = character == '-'
            && before == ' '
            && !is_code
            && characters.peek().is_some_and(char::is_ascii_digit);
        before = character;
        let command = match character {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => {
                written.push('\\');
                written.push(character);
                continue;
            }
            '`' => {
                is_code = !is_code;
                if is_code { r"\texttt{" } else { "}" }
            }
            '\\' => r"\textbackslash{}",
            '~' => r"\textasciitilde{}",
            '^' => r"\textasciicircum{}",
            '<' => "$<$",
            '>' => "$>$",
            '|' => "$|$",
            '"' => r"\textquotedbl{}",
            '–' => "--",
            '…' => r"\dots{}",
            '−' => "$-$",
            // A minus sign before a number, not a hyphen.
            '-' if is_minus => "$-$",
            '≤' => r"$\le$",
            '≥' => r"$\ge$",
            '±' => r"$\pm$",
            '×' => r"$\times$",
            '²' => "$^2$",
            '³' => "$^3$",
            '‖' => r"$\|$",
            '‘' | '’' => "'",
            'γ' => r"$\gamma$",
            'λ' => r"$\lambda$",
            'σ' => r"$\sigma$",
            'ω' => r"$\omega$",
            'η' => r"$\eta$",
            'β' => r"$\beta$",
            'δ' => r"$\delta$",
            _ => {
                // Other scripts, as in the name of a law: left to the engine and its fonts.
                written.push(character);
                continue;
            }
        };
        written.push_str(command);
    }
    if is_code {
        written.push('}');
    }
    written
}

/// Escapes text for HTML.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> TextTable {
        let lines = [
            ["`paper-18`", "-1.5 to -0.2", "50.00 %"],
            ["a_b & c-1", "+0.2", "–"],
        ];
        TextTable::new(
            "RMS ‖p − pd‖, cm",
            &["law", "here\nmedian", "at least"],
            lines.map(|cells| cells.map(str::to_owned).to_vec()),
        )
    }

    #[test]
    fn a_table_in_markdown_has_a_rule_below_its_head() {
        assert_eq!(
            table().markdown(),
            "RMS ‖p − pd‖, cm:\n\n| law | here: median | at least |\n| --- | --- | --- |\n\
             | `paper-18` | -1.5 to -0.2 | 50.00 % |\n| a_b & c-1 | +0.2 | – |\n"
        );
    }

    /// Read by pdfLaTeX of TeX Live 2022 without a warning.
    #[test]
    fn a_table_in_latex_escapes_what_latex_reads() {
        assert_eq!(
            latex_file(&[table()]),
            r"% Written by gerono. In the preamble: \usepackage{booktabs}
\begin{table}
  \centering
  \caption{RMS $\|$p $-$ pd$\|$, cm}
  \begin{tabular}{lrr}
    \toprule
    law & here: median & at least \\
    \midrule
    \texttt{paper-18} & $-$1.5 to $-$0.2 & 50.00 \% \\
    a\_b \& c-1 & +0.2 & -- \\
    \bottomrule
  \end{tabular}
\end{table}
"
        );
    }

    #[test]
    fn a_table_on_a_page_escapes_what_html_reads() {
        let html = TextTable::new("<b>", &["a&b"], [vec!["`1 < 2`".to_owned()]]).html();
        for text in [
            "<h2>&lt;b&gt;</h2>",
            "<th>a&amp;b</th>",
            "<td><code>1 &lt; 2</code></td>",
        ] {
            assert!(html.contains(text), "{html}");
        }
    }

    #[test]
    fn text_with_special_characters_is_shown_as_it_is() {
        assert_eq!(escaped("a < b & \"c\""), "a &lt; b &amp; &quot;c&quot;");
    }
}
