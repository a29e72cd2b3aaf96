//! Results of system identification as a page and as text: accuracy of the robot model's motion, identified parameters,
//! unidentified ones, and useful further measurements.

use std::fmt::Write as _;

use maud::html;
use plant::identified::SessionSource;
use schemars::JsonSchema;
use serde::Serialize;

use crate::html::{ColumnAlignment, HtmlTable, whole_page};

/// Half-width of a 95 % interval, in standard deviations.
const HALF_INTERVAL: f64 = 1.96;

/// Motion of the model of one actuator, compared with the servo's.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ActuatorRow {
    pub actuator: String,
    /// Number of free motions.
    pub motions: usize,
    /// Number of samples of the servo's angle.
    pub samples: usize,
    /// Root-mean-square residual of the servo's angle with the nominal parameters, rad.
    pub residual_before: f64,
    /// Root-mean-square residual of the servo's angle with the identified parameters, rad.
    pub residual_after: f64,
    /// Correlation length of the residual, samples.
    pub correlation_length: f64,
    /// Latency from a command to the measurement, s.
    pub delay: f64,
}

/// Identification result of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ParameterRow {
    pub parameter: String,
    /// Unit of the deviation; `log`: logarithm of the factor on the nominal value.
    pub unit: String,
    /// Deviation from the nominal value.
    pub deviation: f64,
    /// Standard deviation of the estimated deviation.
    pub sigma: f64,
    /// Prior standard deviation among robot instances.
    pub prior_sigma: f64,
    /// True if the sessions determine the parameter better than the prior.
    pub identified: bool,
}

impl ParameterRow {
    /// Formats the row: a factor's deviation in per cent, angles in degrees.
    fn cells(&self) -> [String; 4] {
        let (scale, unit, decimals) = match self.unit.as_str() {
            "log" => (100.0, "%", 1),
            "rad" => (180.0 / std::f64::consts::PI, "deg", 2),
            "m" => (1e3, "mm", 2),
            "N m" => (1e3, "mN m", 2),
            other => (1.0, other, 3),
        };
        let of = |value: f64| format!("{:.decimals$} {unit}", scale * value);
        [
            self.parameter.clone(),
            of(self.deviation),
            of(HALF_INTERVAL * self.sigma),
            of(HALF_INTERVAL * self.prior_sigma),
        ]
    }
}

/// Recommends measurements for the parameters that the sessions did not identify.
fn advice(parameters: &[ParameterRow]) -> Vec<String> {
    let missing = |ending: &str| parameters.iter().any(|row| !row.identified && row.parameter.ends_with(ending));
    let mut advice = Vec::new();
    let mut say = |endings: &[&str], words: &str| {
        let open: Vec<&str> = endings.iter().copied().filter(|ending| missing(ending)).collect();
        if !open.is_empty() {
            advice.push(format!("{}: {words}", open.join(", ")));
        }
    };
    say(&["joint_zero"], "touches of a ball do not push every link onto its stop; press each pad on one, further out");
    say(
        &["encoder", "position", "turn"],
        "touches of a ball leave some of these open: rotation of the whole robot about its base belongs to the base pose (`ftac bridge register`)",
    );
    say(
        &["gel_stiffness", "pad_friction"],
        "too few pads of the palm press on a ball and slide over it; more spots, or a ball that the palm reaches more easily",
    );
    say(
        &["torque_gain"],
        "a payload in the hand shows the gain of every joint that it loads; add postures, a heavier payload, or any payload; never joint 1, whose axis is vertical",
    );
    say(
        &["gel_thickness"],
        "the load on a pad does not depend on the thickness of its gel; measure it with a calliper",
    );
    say(
        &[
            "spring",
            "spring_rest",
            "torque_constant",
            "spool_radius",
            "cable_stiffness",
            "guide_friction",
            "guide_turn",
            "servo_damping",
        ],
        "the motions do not identify some of these; more postures of the arm, or more speeds and loads, in the script",
    );
    advice
}

/// Formats the rows as text for a terminal.
pub fn text(actuators: &[ActuatorRow], parameters: &[ParameterRow]) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:<12} {:>8} {:>8} {:>16} {:>16}",
        "actuator", "motions", "samples", "nominal, deg", "identified, deg"
    );
    for row in actuators {
        let _ = writeln!(
            text,
            "{:<12} {:>8} {:>8} {:>16.2} {:>16.3}",
            row.actuator,
            row.motions,
            row.samples,
            row.residual_before.to_degrees(),
            row.residual_after.to_degrees()
        );
    }
    let _ = writeln!(text, "\n{:<28} {:>12} {:>12} {:>14}", "parameter", "deviation", "95 %: +-", "prior: +-");
    for row in parameters.iter().filter(|row| row.identified) {
        let [name, deviation, interval, spread] = row.cells();
        let _ = writeln!(text, "{name:<28} {deviation:>12} {interval:>12} {spread:>14}");
    }
    let open = parameters.iter().filter(|row| !row.identified).count();
    let _ =
        writeln!(text, "\n{open} parameters are not identifiable from these sessions and keep their nominal values:");
    for line in advice(parameters) {
        let _ = writeln!(text, "  {line}");
    }
    text
}

/// Returns a self-contained page.
pub fn page(actuators: &[ActuatorRow], parameters: &[ParameterRow], sessions: &[SessionSource]) -> String {
    let mut motion = HtmlTable::new(
        "Motion of the servos: root mean square residual of the model",
        &[
            ("actuator", ColumnAlignment::Words),
            ("motions", ColumnAlignment::Numbers),
            ("samples", ColumnAlignment::Numbers),
            ("nominal, deg", ColumnAlignment::Numbers),
            ("identified, deg", ColumnAlignment::Numbers),
            ("delay, ms", ColumnAlignment::Numbers),
        ],
    );
    for row in actuators {
        motion.row(&[
            row.actuator.clone(),
            row.motions.to_string(),
            row.samples.to_string(),
            format!("{:.2}", row.residual_before.to_degrees()),
            format!("{:.3}", row.residual_after.to_degrees()),
            format!("{:.1}", 1e3 * row.delay),
        ]);
    }
    let table = |caption: &str, identified: bool| {
        let head = [
            ("parameter", ColumnAlignment::Words),
            ("deviation from nominal", ColumnAlignment::Numbers),
            ("95 % interval: ±", ColumnAlignment::Numbers),
            ("prior: ±", ColumnAlignment::Numbers),
        ];
        let mut table = HtmlTable::new(caption, &head);
        parameters.iter().filter(|row| row.identified == identified).for_each(|row| table.row(&row.cells()));
        table
    };
    let mut source = HtmlTable::new(
        "Sessions",
        &[
            ("file", ColumnAlignment::Words),
            ("robot", ColumnAlignment::Words),
            ("s", ColumnAlignment::Numbers),
            ("SHA-256", ColumnAlignment::Words),
        ],
    );
    for session in sessions {
        source.row(&[&session.file, &session.robot, &format!("{:.0}", session.seconds), &session.sha256]);
    }
    let body = html! {
        (motion)
        (table("Identified parameters", true))
        h2 { "Further measurements" }
        ul { @for line in advice(parameters) { li { (line) } } }
        (table("Unidentified parameters: nominal value and prior", false))
        (source)
    };
    whole_page("System identification", &body)
}
