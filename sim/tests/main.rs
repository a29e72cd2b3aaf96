//! Tests of the scene's physics, in one program that is linked once.

mod arm_defects;
mod beside_the_table;
mod breaking;
mod cables;
mod other_arms;
mod outside;
mod own_contact;
mod rest;
mod stand;
mod statics;
mod urdf_hand;
