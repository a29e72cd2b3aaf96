//! Tests of whole trials in one program, which is linked once.

mod condition_subsets;
mod failed_look;
mod foresight;
mod ideal_plans;
mod limits;
mod mirror;
mod no_errors;
mod other_order;
mod own_hand;
mod palpation;
mod posture;
mod pressing;
mod same_trial;
mod stopped_body;
