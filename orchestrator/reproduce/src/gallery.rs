//! The report as a web page: one file without scripts, which shows the drawings beside it.

use report::text_table::escaped;

use super::drawings::Drawing;
use super::judgement::{FigureReport, ReproductionReport, RowReport, Verdict};
use super::pages::FlightPage;
use super::table::{cell_text, notes, observability_header, observability_lines};

const STYLE: &str = "
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.9rem; }
th, td { border-bottom: 1px solid #ccc; padding: 0.25rem 0.75rem; text-align: left; }
img { max-width: 100%; height: auto; }
.reached { color: #00684a; }
.known-gap { color: #8a5a00; }
.regressed { color: #b00020; font-weight: bold; }
code { white-space: pre-wrap; }
";

/// Returns the page as HTML.
#[must_use]
pub fn page(report: &ReproductionReport, drawings: &[Drawing], pages: &[FlightPage]) -> String {
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>Gerono: the paper's figures</title>\n\
         <style>{STYLE}</style>\n<h1>The paper's figures, reproduced</h1>\n"
    );
    html += &laboratories(report);
    for figure in &report.figures {
        html += &format!(
            "<h2>Figure {}</h2>\n<p>{}</p>\n",
            figure.figure,
            escaped(figure.title)
        );
        html += &rows(figure);
        for drawing in drawings
            .iter()
            .filter(|drawing| drawing.figure.name() == figure.figure)
        {
            let alt = escaped(drawing.title);
            html += &format!("<p><img src=\"{}\" alt=\"{alt}\"></p>\n", drawing.file);
        }
        for page in pages.iter().filter(|page| page.figure.name() == figure.figure) {
            html += &format!(
                "<p><a href=\"{}\">The flight <i>{}</i>, seed {}, in detail</a>: 3D view, every quantity over time, \
                 events</p>\n",
                page.link(),
                escaped(page.flight),
                report.seeds[0]
            );
        }
    }
    html += &observability(report);
    html += "</html>\n";
    html
}

fn laboratories(report: &ReproductionReport) -> String {
    let seeds: Vec<_> = report.seeds.iter().map(u64::to_string).collect();
    let mut html = format!(
        "<p>Seeds {}, none of which was used for tuning. Numbers are median, worst over the seeds.</p>\n<dl>\n",
        seeds.join(", ")
    );
    for laboratory in &report.laboratories {
        html += &format!(
            "<dt>{}</dt><dd>{}",
            laboratory.column.name(),
            escaped(laboratory.description)
        );
        if !laboratory.settings.is_empty() {
            let settings = escaped(&laboratory.settings.join("\n"));
            html += &format!("<br><code>{settings}</code>");
        }
        html += "</dd>\n";
    }
    html + "</dl>\n"
}

fn rows(figure: &FigureReport) -> String {
    let columns = figure.rows.first().map_or(&[][..], |row| &row.cells[..]);
    let heads: String = columns
        .iter()
        .map(|cell| format!("<th>{}</th>", cell.column.name()))
        .collect();
    let mut html =
        format!("<table>\n<tr><th>quantity</th><th>unit</th><th>paper</th><th>bar</th>{heads}</tr>\n");
    html.extend(figure.rows.iter().map(row));
    html += "</table>\n";
    for (cell, note) in notes(std::slice::from_ref(figure)) {
        html += &format!("<p><small>{}: {}</small></p>\n", escaped(&cell), escaped(&note));
    }
    html
}

fn row(row: &RowReport) -> String {
    let cells = row.cells.iter().map(|cell| {
        let class = match cell.verdict {
            Some(Verdict::Reached) => "reached",
            Some(Verdict::KnownGap) => "known-gap",
            Some(Verdict::Regressed) => "regressed",
            Some(Verdict::NotJudged) | None => "shown",
        };
        format!("<td class=\"{class}\">{}</td>", escaped(&cell_text(cell)))
    });
    format!(
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td>{}</tr>\n",
        escaped(row.quantity),
        row.unit,
        escaped(row.paper),
        row.bar.text(),
        cells.collect::<String>()
    )
}

fn observability(report: &ReproductionReport) -> String {
    let Some(observability) = &report.observability else {
        return String::new();
    };
    let heads: String = observability_header()
        .map(|head| format!("<th>{}</th>", escaped(head)))
        .concat();
    let mut html = format!(
        "<h2>Observability of the mass</h2>\n<p>RMSE of m̂ after 45 s, g, median over {} seeds</p>\n\
         <table>\n<tr>{heads}</tr>\n",
        observability.seeds.len()
    );
    for line in observability_lines(observability) {
        let cells: String = line.map(|cell| format!("<td>{cell}</td>")).concat();
        html += &format!("<tr>{cells}</tr>\n");
    }
    html + "</table>\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawings::DRAWINGS;
    use crate::figures::Figure;
    use crate::flight::FlightResults;
    use crate::judgement::{judge, laboratories};
    use crate::known_gaps::KnownGaps;

    #[test]
    fn the_page_shows_every_number_drawing_and_flight_of_its_figures_and_no_other() {
        let gaps = KnownGaps::default();
        let figures = [Figure::Fig1, Figure::Fig3To6];
        let report = ReproductionReport {
            seeds: vec![101],
            laboratories: laboratories(),
            figures: figures
                .map(|figure| judge(figure, &FlightResults::default(), &[101], &gaps))
                .into(),
            observability: None,
        };
        let pages: Vec<_> = Figure::ALL
            .into_iter()
            .filter_map(FlightPage::for_figure)
            .collect();
        let page = page(&report, &DRAWINGS, &pages);
        for flight in pages {
            let is_linked = page.contains(&format!("href=\"{}\"", flight.link()));
            assert_eq!(is_linked, figures.contains(&flight.figure), "{flight:?}");
        }
        for row in report.figures.iter().flat_map(|figure| &figure.rows) {
            assert!(page.contains(&escaped(row.quantity)), "{}", row.quantity);
        }
        for drawing in DRAWINGS {
            let is_shown = page.contains(&format!("src=\"{}\"", drawing.file));
            assert_eq!(is_shown, figures.contains(&drawing.figure), "{}", drawing.file);
        }
        assert!(!page.contains("<script"));
        assert_eq!(page.matches("<table>").count(), page.matches("</table>").count());
    }
}
