//! Shapes of objects, with their queries: signed distance, ray, volume, inertia, tessellation.
//!
//! A [`Shape`] is given in its own frame (`object/<name>`), in metres. Queries of primitives are in closed form, those of
//! meshes go through parry. Mesh files are OBJ, STL, PLY or glTF. All commands load a user's mesh with [`Mesh::load`], which
//! reads it and mends its faults ([`Mesh::repaired`], [`Repair`]).

mod collada;
mod decomposition;
mod grid;
mod link_mesh;
mod mend;
mod mesh;
mod mesh_file;
mod obj;
mod primitive;
mod relief;
mod repair;
mod revolution;
mod shape;
mod simplify;
mod tessellation;
mod triangle_surface;
mod winding;

pub use grid::DistanceGrid;
pub use link_mesh::LINK_MESHES;
pub use mesh::{GeometryError, MAX_EXTENT, Mesh, Triangles};
pub use mesh_file::{read_triangles, to_obj};
pub use relief::Relief;
pub use repair::Repair;
pub use revolution::{Profile, hull_mesh, hull_triangles, revolve};
pub use shape::Shape;
pub use tessellation::Tessellation;
pub use triangle_surface::TriangleSurface;
pub use winding::Winding;

#[cfg(test)]
mod tests;
