//! Page on the current state of a trial: phase, the candidates of a decision as a table, the latest log lines, and a
//! legend of colours.

/// A candidate of a decision.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredCandidate {
    /// Number of the grasp.
    pub grasp: u32,
    /// Offset of the aim from the detected position, mm.
    pub aim: [f64; 2],
    /// Clearance, mm; `None` if it was not needed.
    pub clearance: Option<f64>,
    /// Probabilities: of an unwanted contact (`risk`) and of a hold (`held`).
    pub risk: f64,
    pub held: f64,
    /// Score.
    pub score: f64,
    /// Role: `plan`, `chosen`, `plan, chosen`, or empty.
    pub mark: &'static str,
}

/// Maximum number of table rows.
const MAX_ROWS: usize = 5;
/// Number of log lines shown, and the time for which they are shown, s.
const LOG_LINES: (usize, f64) = (2, 12.0);
/// Legends of colours: with the true scene known, and with measurements only.
const LEGENDS: [&str; 2] = [
    "solid: true pose; cyan: pose estimate, greying with age, with 2 s.d. of its position",
    "cyan: pose estimate, greying with age, with 2 s.d. of its position; no ground truth",
];
const COMMON_LEGEND: &str = "pads glow where touched; cables blue 0 N to red 40 N; arrows 5 mm/N, red between objects; green: chosen path; \
     red: rejected path, with its closest approach";

/// State of the page.
#[derive(Debug, Clone, Default)]
pub struct StatePage {
    title: String,
    phase: String,
    lines: Vec<(f64, String)>,
    table: Vec<ScoredCandidate>,
    outcome: Option<String>,
    /// True if the true scene is recorded.
    truth: bool,
}

impl StatePage {
    /// Creates an empty page. `truth`: the true scene is recorded.
    pub fn new(truth: bool) -> Self {
        Self { truth, ..Self::default() }
    }

    /// Sets the title. Here and in lines and outcome, names of objects are shown as words.
    pub fn set_title(&mut self, title: &str) {
        self.title = words(title);
    }

    pub fn set_phase(&mut self, phase: &str) {
        phase.clone_into(&mut self.phase);
    }

    pub fn set_outcome(&mut self, outcome: &str) {
        self.outcome = Some(words(outcome));
    }

    /// Adds a line of the log at `time`, s.
    pub fn add(&mut self, time: f64, line: &str) {
        self.lines.push((time, words(line)));
    }

    /// Sets the candidates of a decision; empty when it is over.
    pub fn set_candidates(&mut self, options: Vec<ScoredCandidate>) {
        self.table = options;
    }

    /// Returns the page at `time` (s) as Markdown.
    pub fn page(&self, time: f64) -> String {
        let phase = if self.phase.is_empty() { "—" } else { &self.phase };
        let mut page = format!("### {phase}\n{}\n", self.title);
        if let Some(outcome) = &self.outcome {
            page += &format!("\n**{outcome}**\n");
        }
        // The table already contains the content of the log line about the decision.
        if !self.table.is_empty() {
            return page + &table(&self.table) + &self.legend();
        }
        let (count, age) = LOG_LINES;
        let recent = self.lines.iter().rev().take(count).take_while(|(at, _)| time - at < age);
        let mut recent: Vec<String> = recent.map(|(at, line)| format!("- {at:.1} s: {line}")).collect();
        recent.reverse();
        if !recent.is_empty() {
            page += &format!("\n{}\n", recent.join("\n"));
        }
        page + &self.legend()
    }

    fn legend(&self) -> String {
        format!("\n---\n{}; {COMMON_LEGEND}.\n", LEGENDS[usize::from(!self.truth)])
    }
}

/// Returns a text without the underscores of names, which Markdown takes for emphasis.
fn words(text: &str) -> String {
    text.replace('_', " ")
}

/// Returns the table: planned grasp, chosen candidate, and the best of the others.
fn table(options: &[ScoredCandidate]) -> String {
    let mut order: Vec<&ScoredCandidate> = options.iter().collect();
    order.sort_by(|a, b| a.mark.is_empty().cmp(&b.mark.is_empty()).then(b.score.total_cmp(&a.score)));
    let mut text =
        "\n| grasp | aim (mm) | clearance | risk | holds | score | |\n|---|---|---|---|---|---|---|\n".to_owned();
    for ScoredCandidate { grasp, aim: [x, y], clearance, risk, held, score: worth, mark } in order.iter().take(MAX_ROWS)
    {
        let clearance = clearance.map_or("–".to_owned(), |mm| format!("{mm:.1} mm"));
        let bold = if mark.ends_with("chosen") { "**" } else { "" };
        text += &format!(
            "| {bold}{grasp}{bold} | {x:.0}, {y:.0} | {clearance} | {risk:.2} | {held:.2} | {worth:.2} | {bold}{mark}{bold} |\n"
        );
    }
    match order.len().saturating_sub(MAX_ROWS) {
        0 => text,
        left => text + &format!("\n{left} more; a dash: could not win, clearance not computed\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn option(grasp: u32, worth: f64, mark: &'static str) -> ScoredCandidate {
        ScoredCandidate { grasp, aim: [4.0, -4.0], clearance: None, risk: 0.1, held: worth, score: worth, mark }
    }

    /// Planned and chosen candidates are in the table even if many others have a higher score; old lines disappear.
    #[test]
    fn the_page_shows_what_matters_now() {
        let mut now = StatePage::new(true);
        now.set_phase("decide");
        now.set_title("salt_mill, then can_66");
        now.add(1.0, "first line of salt_mill");
        let mut options = vec![option(7, 0.2, "plan")];
        options.extend((0..9).map(|n| option(20 + n, 0.9, "")));
        options.push(option(99, 0.5, "chosen"));
        now.set_candidates(options);
        let page = now.page(5.0);
        assert!(page.starts_with("### decide") && page.contains("| 7 |") && page.contains("**99**"), "{page}");
        assert_eq!(page.matches("| 4, -4 |").count(), MAX_ROWS);
        assert!(page.contains("6 more") && page.contains("solid: true pose"), "{page}");
        now.set_candidates(Vec::new());
        assert!(now.page(5.0).contains("1.0 s: first line of salt mill") && !now.page(5.0).contains("clearance |"));
        assert!(!now.page(20.0).contains("first line"));
        assert!(now.page(20.0).contains("salt mill, then can 66"), "{page}");
    }
}
