//! Page made from the figures.

use std::fmt::Write as _;

use super::figure::LabBookFigure;

const INTRODUCTION: &str = "\
# Figures

The current figures of this project beside the paper's and the goals, each with the command that measures it again.
`ftac report --lab-book` makes this page from [recordings/figures.csv](recordings/figures.csv), with the commit and machine of each measurement.
Experiments, their results and the history of the figures are in [recordings/log](recordings/log).

Brackets are 95 % intervals, n is the number of samples, `ftac` stands for `cargo run --release --`. A figure in the paper column that is not the paper's names its source.
";

const OTHER_FIGURES_INTRODUCTION: &str = "
## Beside the paper

Every figure that the paper states and this project measures; they are also in the tables of their groups. Panels c and d of the paper's figure on adaptive behaviours, drawn
with its values beside ours, and the commands for its demonstrations without figures are in the `report.html` of `ftac bench`.

";
const TABLE_HEAD: &str = "| figure | ours | unit | paper | goal | seed | command |\n|---|---|---|---|---|---|---|\n";

/// Returns `BENCHMARKS.md`: first the figures stated in the paper, then a table for each group. Groups and figures are
/// in the order of their first appearance.
pub fn page(figures: &[LabBookFigure]) -> String {
    let mut groups: Vec<&str> = Vec::new();
    for figure in figures {
        if !groups.contains(&figure.group.as_str()) {
            groups.push(&figure.group);
        }
    }
    let mut page = INTRODUCTION.to_owned();
    let stated: Vec<&LabBookFigure> = figures.iter().filter(|figure| is_paper_figure(&figure.paper)).collect();
    if !stated.is_empty() {
        page.push_str(OTHER_FIGURES_INTRODUCTION);
        page.push_str(TABLE_HEAD);
        stated.into_iter().for_each(|figure| page.push_str(&row(figure)));
    }
    for group in groups {
        let _ = write!(page, "\n## {group}\n\n{TABLE_HEAD}");
        for figure in figures.iter().filter(|figure| figure.group == group) {
            page.push_str(&row(figure));
        }
    }
    page
}

/// True for a figure of the paper; that of another source names it, as in `Taxim: 31.4`.
fn is_paper_figure(stated: &str) -> bool {
    !stated.is_empty() && !stated.contains(": ")
}

fn row(figure: &LabBookFigure) -> String {
    let mut ours = figure.value.to_string();
    if let Some((low, high)) = &figure.interval {
        let _ = write!(ours, " [{low}, {high}]");
    }
    if let Some(n) = figure.n {
        let _ = write!(ours, ", n = {n}");
    }
    let seed = match figure.seed {
        None => String::new(),
        Some((first, last)) if first == last => first.to_string(),
        Some((first, last)) => format!("{first} to {last}"),
    };
    let command = format!("`{}`", figure.command);
    let cells = [&figure.label, &ours, &figure.unit, &figure.paper, &figure.goal, &seed, &command];
    let cells = cells.map(|cell| if cell.is_empty() { "-".to_owned() } else { cell.replace('|', "\\|") });
    format!("| {} |\n", cells.join(" | "))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::table;
    use super::*;

    fn rows_of(rows: &str) -> String {
        let figures = table::parse(Path::new("figures.csv"), &format!("{}\n{rows}", table::COLUMNS.join(","))).unwrap();
        let page = page(&figures);
        page.strip_prefix(INTRODUCTION).unwrap().to_owned()
    }

    #[test]
    fn a_table_for_each_group_in_order_of_appearance() {
        let page = rows_of(
            "b.one,0.980,share,0.97,0.99,600,1,,2 cores,yes,ftac bench,,Second,one,1.000,0.98,\n\
             a.two,3,mm,,,,1-3,,2 cores,no,ftac hand check,,First,two | three,,,not shown\n\
             b.three,4,,,,,,,2 cores,no,ftac bench,,Second,three,Taxim: 5,,\n",
        );
        assert_eq!(
            page,
            format!(
                "{OTHER_FIGURES_INTRODUCTION}{TABLE_HEAD}\
                 | one | 0.980 [0.97, 0.99], n = 600 | share | 1.000 | 0.98 | 1 | `ftac bench` |\n\
                 \n## Second\n\n{TABLE_HEAD}\
                 | one | 0.980 [0.97, 0.99], n = 600 | share | 1.000 | 0.98 | 1 | `ftac bench` |\n\
                 | three | 4 | - | Taxim: 5 | - | - | `ftac bench` |\n\
                 \n## First\n\n{TABLE_HEAD}\
                 | two \\| three | 3 | mm | - | - | 1 to 3 | `ftac hand check` |\n"
            )
        );
    }
}
