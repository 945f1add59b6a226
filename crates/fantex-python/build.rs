//! Extension modules are loaded into an interpreter that has Python's symbols; some linkers must be told.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
