//! Writes `docs/look.schema.json` and the tables of `docs/look.md`: run it in the project's folder after a change of the
//! tables (`cargo xtask schema` does).

use std::error::Error;
use std::fs;

use fantex_look::look_schema;
use fantex_look::reference::fill_reference;

fn main() -> Result<(), Box<dyn Error>> {
    fs::write("docs/look.schema.json", serde_json::to_string_pretty(look_schema())? + "\n")?;
    let page = fs::read_to_string("docs/look.md")?;
    fs::write("docs/look.md", fill_reference(&page)?)?;
    Ok(())
}
