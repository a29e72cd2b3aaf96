//! Shapes of objects, with their queries: signed distance, ray, volume, inertia, tessellation.
//!
//! A [`ObjectShape`] is given in its own frame (`object/<name>`), in metres. Queries of primitives are in closed form,
//! those of meshes go through parry. Mesh files are OBJ, STL, PLY or glTF. All commands load a user's mesh with
//! [`Mesh::load`], which reads it and mends its faults ([`Mesh::repaired`], [`RepairReport`]).

mod collada;
mod decomposition;
mod grid;
mod link_mesh;
mod mesh;
mod mesh_file;
mod mesh_height_map;
mod obj;
mod primitive;
mod rebuild;
mod repair;
mod revolution;
mod shape;
mod simplify;
mod standing_hull;
mod tessellation;
mod triangle_surface;
mod winding;

pub use grid::DistanceGrid;
pub use link_mesh::LINK_MESHES;
pub use mesh::{GeometryError, MAX_EXTENT, Mesh, Triangles};
pub use mesh_file::{read_triangles, to_obj};
pub use mesh_height_map::MeshHeightMap;
pub use repair::RepairReport;
pub use revolution::{Profile, hull_mesh, hull_triangles, revolve};
pub use shape::ObjectShape;
pub use standing_hull::standing_hull;
pub use tessellation::Tessellation;
pub use triangle_surface::TriangleSurface;
pub use winding::WindingTree;

#[cfg(test)]
mod tests;
