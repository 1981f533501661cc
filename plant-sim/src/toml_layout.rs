//! How a written parameter file looks: one line per number, with its uncertainty and source, numbers short enough to read.

use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, Value};

/// Lays `text` out anew; the values stay the same to the last bit.
pub(crate) fn lay_out(text: &str) -> Result<String, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    lay_out_table(document.as_table_mut());
    Ok(document.to_string())
}

fn lay_out_table(table: &mut Table) {
    for (mut key, item) in table.iter_mut() {
        match item {
            Item::Table(record) if record.contains_key("value") => {
                *item = Item::Value(Value::InlineTable(inline(record)));
                // It was a header; as a key it has no spaces around it yet.
                key.fmt();
            }
            Item::Table(inner) => lay_out_table(inner),
            Item::ArrayOfTables(records) if records.iter().all(|record| record.contains_key("value")) => {
                *item = Item::Value(Value::Array(lines(records)));
                key.fmt();
            }
            Item::ArrayOfTables(tables) => tables.iter_mut().for_each(lay_out_table),
            Item::Value(value) => shorten(value),
            Item::None => {}
        }
    }
}

fn inline(record: &mut Table) -> InlineTable {
    let mut record = std::mem::take(record).into_inline_table();
    record.iter_mut().for_each(|(_, value)| shorten(value));
    record.fmt();
    record
}

/// Records below one another.
fn lines(records: &mut ArrayOfTables) -> Array {
    let mut array = Array::new();
    for record in records.iter_mut() {
        let mut value = Value::InlineTable(inline(record));
        value.decor_mut().set_prefix("\n    ");
        array.push_formatted(value);
    }
    array.set_trailing("\n");
    array.set_trailing_comma(true);
    array
}

/// Rewrites a float that needs many zeros in scientific notation, which Rust prints with as few digits as identify it.
fn shorten(value: &mut Value) {
    match value {
        Value::Float(float) => {
            let number = *float.value();
            let plain = number.abs() >= 1e-3 && number.abs() < 1e6 || number == 0.0;
            let text = if plain { format!("{number:?}") } else { format!("{number:e}") };
            if let Ok(shorter) = text.parse::<Value>()
                && shorter.as_float() == Some(number)
            {
                *value = shorter;
            }
        }
        Value::Array(array) => array.iter_mut().for_each(shorten),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn lists_of_records_stand_below_one_another() {
        let text =
            "[a]\n[[a.w]]\nvalue = 1.5\nsource = \"x\"\n[[a.w]]\nvalue = 2.0\nsource = \"y\"\n[[a.other]]\nk = 1\n";
        let laid_out = super::lay_out(text).expect("valid TOML");
        let wanted = "w = [\n    { value = 1.5, source = \"x\" },\n    { value = 2.0, source = \"y\" },\n]\n";
        assert!(laid_out.contains(wanted) && laid_out.contains("[[a.other]]"), "{laid_out}");
        let before: toml::Table = text.parse().expect("valid TOML");
        let after: toml::Table = laid_out.parse().expect("valid TOML");
        assert_eq!(before, after);
    }

    #[test]
    fn records_stand_on_one_line_and_keep_their_bits() {
        let text = "[a]\nb = 0.00000055315\n[a.c]\nvalue = 0.0000005531529038742114\nsource = \"x\"\n";
        let laid_out = super::lay_out(text).expect("valid TOML");
        assert!(laid_out.contains("\nc = { value = 5.531529038742114e-7, source = \"x\" }"), "{laid_out}");
        let before: toml::Table = text.parse().expect("valid TOML");
        let after: toml::Table = laid_out.parse().expect("valid TOML");
        assert_eq!(before, after);
    }
}
