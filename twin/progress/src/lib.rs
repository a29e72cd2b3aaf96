//! Progress of long work: a bar drawn in place on a terminal, or occasional lines if stderr is redirected to a log.
//! Also makes text of third parties safe for a terminal ([`printable`]). [`interrupt`] notes Ctrl-C.

pub mod interrupt;
mod printable;

use std::io::{self, IsTerminal as _, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

pub use indicatif::ProgressBar;
use indicatif::{HumanDuration, ProgressDrawTarget, ProgressState, ProgressStyle, TermLike};

pub use self::printable::{printable, write_to_stderr};

/// Interval between lines in a log.
const LOG_INTERVAL: Duration = Duration::from_secs(30);
/// Width of a line in a log, columns.
const LOG_COLUMNS: u16 = 160;
/// Interval between redraws of a bar while nothing happens, so that a log has its lines during long steps, too.
const REDRAW_INTERVAL: Duration = Duration::from_secs(1);

/// Creates a bar of `length` steps, called `what`, on stderr; hidden if `quiet`. It shows steps, elapsed time, time
/// left and rate.
pub fn bar(length: u64, what: &str, quiet: bool) -> ProgressBar {
    make_bar(Some(length), 0, what, quiet)
}

/// As [`bar`], for work resumed after `done` steps, which do not count for the rate.
pub fn resumed_bar(length: u64, done: u64, what: &str, quiet: bool) -> ProgressBar {
    make_bar(Some(length), done, what, quiet)
}

/// As [`bar`], for work of unknown length.
pub fn open_ended_bar(quiet: bool) -> ProgressBar {
    make_bar(None, 0, "", quiet)
}

fn make_bar(length: Option<u64>, done: u64, what: &str, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(length, draw_target(quiet)).with_position(done);
    let template = format!("{{bar:28}} {{pos}}/{{len}} {what} [{{elapsed}} < {{left}}, {{rate}}] {{msg}}");
    let begun = Instant::now();
    // The rate is an average over all of the time: the bar's own estimate covers only seconds, and steps may take
    // minutes.
    let per_second = move |state: &ProgressState| {
        state.pos().saturating_sub(done) as f64 / begun.elapsed().as_secs_f64().max(f64::MIN_POSITIVE)
    };
    let bar = match ProgressStyle::with_template(&template) {
        // A bar cannot report that it cannot be drawn.
        Ok(style) => bar.with_style(
            style
                .with_key("rate", move |state: &ProgressState, to: &mut dyn std::fmt::Write| {
                    let _ = to.write_str(&format_rate(per_second(state)));
                })
                .with_key("left", move |state: &ProgressState, to: &mut dyn std::fmt::Write| {
                    let _ = to.write_str(&format_time_left(
                        state.len().unwrap_or(0).saturating_sub(state.pos()),
                        per_second(state),
                    ));
                }),
        ),
        Err(_) => bar,
    };
    if !bar.is_hidden() {
        bar.enable_steady_tick(REDRAW_INTERVAL);
    }
    bar
}

/// Formats the time that `steps` take at a rate; unknown before the first step.
fn format_time_left(steps: u64, per_second: f64) -> String {
    match Duration::try_from_secs_f64(steps as f64 / per_second) {
        Ok(left) => format!("{:#}", HumanDuration(left)),
        Err(_) => "?".to_owned(),
    }
}

/// Formats a rate in steps per second, or per minute or hour if they are slow.
fn format_rate(per_second: f64) -> String {
    match per_second {
        fast if fast >= 1.0 => format!("{fast:.1}/s"),
        slow if slow >= 1.0 / 60.0 => format!("{:.1}/min", 60.0 * slow),
        slower => format!("{:.1}/h", 3600.0 * slower),
    }
}

/// Returns the target of a bar: hidden if `quiet`, else stderr.
pub fn draw_target(quiet: bool) -> ProgressDrawTarget {
    match (quiet, io::stderr().is_terminal()) {
        (true, _) => ProgressDrawTarget::hidden(),
        (false, true) => ProgressDrawTarget::stderr(),
        (false, false) => ProgressDrawTarget::term_like(Box::new(LogTerminal::new(io::stderr()))),
    }
}

/// A log in the role of a terminal: keeps the drawing of a bar, and writes it as one line each [`LOG_INTERVAL`].
#[derive(Debug)]
struct LogTerminal<W> {
    state: Mutex<LogState<W>>,
}

#[derive(Debug)]
struct LogState<W> {
    out: W,
    /// Text drawn since the last flush.
    pending_text: String,
    /// Time of the last written line, or of the beginning of the work before the first one.
    last_written: Instant,
}

impl<W> LogTerminal<W> {
    fn new(out: W) -> Self {
        Self { state: Mutex::new(LogState { out, pending_text: String::new(), last_written: Instant::now() }) }
    }
}

impl<W: Write> LogState<W> {
    /// Ends a drawing at `now`.
    fn flush(&mut self, now: Instant) -> io::Result<()> {
        let drawn = std::mem::take(&mut self.pending_text);
        let line = drawn.trim();
        if line.is_empty() || now.duration_since(self.last_written) < LOG_INTERVAL {
            return Ok(());
        }
        self.last_written = now;
        writeln!(self.out, "{line}")
    }
}

impl<W: Write + Send + std::fmt::Debug> TermLike for LogTerminal<W> {
    fn width(&self) -> u16 {
        LOG_COLUMNS
    }

    fn move_cursor_up(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_down(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_right(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_left(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn write_line(&self, text: &str) -> io::Result<()> {
        self.write_str(text)
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        if let Ok(mut state) = self.state.lock() {
            state.pending_text.push_str(text);
        }
        Ok(())
    }

    fn clear_line(&self) -> io::Result<()> {
        Ok(())
    }

    fn flush(&self) -> io::Result<()> {
        self.state.lock().map_or(Ok(()), |mut state| state.flush(Instant::now()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of many drawings the log gets one per period, whole and without control characters.
    #[test]
    fn a_log_gets_a_line_now_and_then() {
        let begun = Instant::now();
        let mut state = LogState { out: Vec::new(), pending_text: String::new(), last_written: begun };
        for second in 1..=70 {
            state.pending_text = format!("\r{second}/70 trials   ");
            state.flush(begun + Duration::from_secs(second)).expect("a log");
        }
        assert_eq!(String::from_utf8(state.out).expect("text"), "30/70 trials\n60/70 trials\n");
    }

    #[test]
    fn rates_are_in_a_unit_that_can_be_read() {
        assert_eq!([12.34, 0.5, 0.001, 0.0].map(format_rate), ["12.3/s", "30.0/min", "3.6/h", "0.0/h"]);
    }

    #[test]
    fn time_left_is_that_of_the_rate() {
        assert_eq!(
            [(30, 0.5), (7200, 1.0), (0, 1.0), (5, 0.0)].map(|(steps, rate)| format_time_left(steps, rate)),
            ["60s", "2h", "0s", "?"]
        );
    }

    /// The drawing of a bar arrives in a log as one line with its count.
    #[test]
    fn a_bar_draws_into_a_log() {
        let log = LogTerminal::new(Vec::new());
        log.state.lock().expect("the log").last_written -= LOG_INTERVAL;
        let shared = std::sync::Arc::new(log);
        #[derive(Debug)]
        struct Shared(std::sync::Arc<LogTerminal<Vec<u8>>>);
        impl TermLike for Shared {
            fn width(&self) -> u16 {
                self.0.width()
            }
            fn move_cursor_up(&self, n: usize) -> io::Result<()> {
                self.0.move_cursor_up(n)
            }
            fn move_cursor_down(&self, n: usize) -> io::Result<()> {
                self.0.move_cursor_down(n)
            }
            fn move_cursor_right(&self, n: usize) -> io::Result<()> {
                self.0.move_cursor_right(n)
            }
            fn move_cursor_left(&self, n: usize) -> io::Result<()> {
                self.0.move_cursor_left(n)
            }
            fn write_line(&self, text: &str) -> io::Result<()> {
                self.0.write_line(text)
            }
            fn write_str(&self, text: &str) -> io::Result<()> {
                self.0.write_str(text)
            }
            fn clear_line(&self) -> io::Result<()> {
                self.0.clear_line()
            }
            fn flush(&self) -> io::Result<()> {
                self.0.flush()
            }
        }
        let bar = bar(4, "trials", true);
        bar.set_draw_target(ProgressDrawTarget::term_like(Box::new(Shared(shared.clone()))));
        bar.inc(3);
        bar.tick();
        let state = shared.state.lock().expect("the log");
        let text = String::from_utf8_lossy(&state.out);
        assert!(text.contains("3/4 trials [") && text.lines().count() == 1 && !text.contains('\r'), "{text:?}");
    }
}
