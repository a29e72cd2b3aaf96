//! A chooser whose decisions come from an external policy, through its host.

use std::sync::Arc;

use control::policy::chosen::{Answer, Chooser, ChooserError, Situation};
use hand_model::Hand;
use hand_model::robot::TactileImage;
use serde_json::Value;

use super::host::{Array, Host};
use super::message;

/// Asks a host for the decisions.
pub struct HostChooser<'a> {
    host: &'a mut dyn Host,
    hand: &'a Hand,
    /// Images of the untouched pads, one a camera.
    untouched: &'a [Arc<TactileImage>],
    /// Question that is asked before the first decision.
    reset: Option<Value>,
}

impl<'a> HostChooser<'a> {
    /// A chooser for a trial that begins with the question `reset`; `untouched` are the images of the untouched pads.
    pub fn new(host: &'a mut dyn Host, hand: &'a Hand, untouched: &'a [Arc<TactileImage>], reset: Value) -> Self {
        Self { host, hand, untouched, reset: Some(reset) }
    }
}

impl Chooser for HostChooser<'_> {
    fn choose(&mut self, situation: &Situation) -> Result<Answer, ChooserError> {
        if let Some(reset) = self.reset.take() {
            self.host.ask(&reset, &[])?;
        }
        let images = situation.images.iter().map(|frame| &frame.image).chain(self.untouched);
        let pictures: Vec<Array> = images.map(Array::picture).collect();
        Ok(message::chosen(self.host.ask(&message::choose(self.hand, situation), &pictures)?)?)
    }
}
