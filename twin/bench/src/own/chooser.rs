//! A policy that chooses grasps, asked through its host.

use control::policy::chosen::{Answer, Chooser, ChooserError, Situation};
use hand_model::Hand;
use serde_json::Value;

use super::host::{Array, Host};
use super::message;

/// Asks a host.
pub struct HostChooser<'a> {
    host: &'a mut dyn Host,
    hand: &'a Hand,
    /// What is asked first.
    reset: Option<Value>,
}

impl<'a> HostChooser<'a> {
    /// For a trial that begins with the question `reset`.
    pub fn new(host: &'a mut dyn Host, hand: &'a Hand, reset: Value) -> Self {
        Self { host, hand, reset: Some(reset) }
    }
}

impl Chooser for HostChooser<'_> {
    fn choose(&mut self, situation: &Situation) -> Result<Answer, ChooserError> {
        if let Some(reset) = self.reset.take() {
            self.host.ask(&reset, &[])?;
        }
        let pictures: Vec<Array> = situation.images.iter().map(|frame| Array::picture(&frame.image)).collect();
        Ok(message::chosen(self.host.ask(&message::choose(self.hand, situation), &pictures)?)?)
    }
}
