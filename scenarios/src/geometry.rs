//! Shapes of objects and the questions asked of them: signed distance, ray, volume, inertia, tessellation.
//!
//! A [`Shape`] lives in its own frame (`object/<name>`), metres. Primitives answer in closed form, meshes through parry.
//! Mesh files are OBJ, STL, PLY or glTF. [`Mesh::mended`] makes a watertight mesh from triangles that are not, by their winding number
//! ([`Winding`]).

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
mod revolution;
mod shape;
mod tessellation;
mod triangle_surface;
mod winding;

pub use grid::DistanceGrid;
pub use link_mesh::LINK_MESHES;
pub use mesh::{GeometryError, MAX_EXTENT, Mesh};
pub use mesh_file::{Triangles, read_triangles, to_obj};
pub use relief::Relief;
pub use revolution::{Profile, hull_mesh, revolve};
pub use shape::Shape;
pub use tessellation::Tessellation;
pub use triangle_surface::TriangleSurface;
pub use winding::Winding;

#[cfg(test)]
mod tests;
