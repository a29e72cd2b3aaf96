//! Tests of the scene's physics, in one program that is linked once.

mod arm_defects;
mod beside_the_table;
mod cables;
mod external;
mod fault_injection;
mod other_arms;
mod rest;
mod self_contact;
mod stand;
mod statics;
mod urdf_hand;
