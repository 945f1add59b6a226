//! What the Python package `fantex` is written on: the front door with arrays of numbers in and out.
//!
//! Functions here are strict about types and shapes; `python/fantex` turns what users have into them. Long work runs on a thread of its
//! own, without the interpreter's lock, while the calling thread answers signals and tells of progress (`watch.rs`).

mod arrays;
mod asset;
mod bake;
mod change;
mod export;
mod function;
mod looks;
mod mesh;
mod options;
mod picture;
mod places;
mod watch;
mod world;

// Free-threaded interpreters need no lock for it: classes are frozen, what they share is behind locks of its own or never changes
// (`Asset`'s page cache), and arrays are copied before work begins.
#[pyo3::pymodule(gil_used = false)]
mod _native {
    #[pymodule_export]
    use crate::asset::{Asset, kind};
    #[pymodule_export]
    use crate::bake::{Plan, bake, bake_model, bake_part, merge, plan};
    #[pymodule_export]
    use crate::change::{make_preview, paint, remove_preview, save_strokes};
    #[pymodule_export]
    use crate::looks::{look_figures, normal_map, render_look, table};
    #[pymodule_export]
    use crate::mesh::{Mesh, cut_polygons, parametrize};
    #[pymodule_export]
    use crate::options::set_read_limits;
    #[pymodule_export]
    use crate::picture::{compare, compare_pictures, decode_image, encode_png};
    #[pymodule_export]
    use crate::places::{check_target, is_there, remove_object, upload, write_whole};
    #[pymodule_export]
    use crate::watch::{Error, tell};
    #[pymodule_export]
    use crate::world::{World, change_world, split, verify_index};

    /// The version of fantex.
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_init]
    fn init(module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        use pyo3::types::PyModuleMethods;
        module.add("NOTICES", fantex_assets::NOTICES)?;
        module.add("SOLIDS", fantex::texture::SOLID_NAMES.to_vec())?;
        let table = fantex::texture::color::linear_from_srgb8_table();
        module.add("LINEAR_FROM_SRGB8", table.to_vec())
    }
}
