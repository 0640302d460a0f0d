//! The C header against the types of this crate.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::process::Command;

use eigenhand_hand_abi::{
    ABI_MAJOR, ABI_MINOR, Bytes, HandPlugin, Header, MAGIC, STATUS_ERROR, STATUS_OK, STATUS_PANIC, SYMBOL, Status,
};

/// Runs the system's C compiler.
fn cc(arguments: &[&str]) {
    let include = Path::new(env!("CARGO_MANIFEST_DIR")).join("include");
    let output = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"])
        .arg(include)
        .args(arguments)
        .output()
        .unwrap_or_else(|error| panic!("cannot run cc, a C compiler, which this test needs: {error}"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn scratch(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// Compiles and runs a C program that prints one expression a line.
fn values(expressions: &[&str]) -> Vec<u64> {
    let (source, program) = (scratch("header.c"), scratch("header"));
    let lines: String =
        expressions.iter().map(|e| format!("    printf(\"%llu\\n\", (unsigned long long)({e}));\n")).collect();
    let text =
        format!("#include <stdio.h>\n#include \"eigenhand_hand.h\"\nint main(void) {{\n{lines}    return 0;\n}}\n");
    std::fs::write(&source, text).unwrap();
    cc(&[source.to_str().unwrap(), "-o", program.to_str().unwrap()]);
    let output = Command::new(program).output().unwrap();
    String::from_utf8(output.stdout).unwrap().lines().map(|line| line.parse().unwrap()).collect()
}

#[test]
fn the_header_says_what_the_types_say() {
    let table = |field: &str| format!("offsetof(eigenhand_hand_plugin_t, {field})");
    let header_at = offset_of!(HandPlugin, header);
    let expected: Vec<(String, usize)> = vec![
        ("EIGENHAND_HAND_MAGIC".into(), MAGIC as usize),
        ("EIGENHAND_HAND_ABI_MAJOR".into(), ABI_MAJOR as usize),
        ("EIGENHAND_HAND_ABI_MINOR".into(), ABI_MINOR as usize),
        ("EIGENHAND_HAND_OK".into(), STATUS_OK as usize),
        ("EIGENHAND_HAND_ERROR".into(), STATUS_ERROR as usize),
        ("EIGENHAND_HAND_PANIC".into(), STATUS_PANIC as usize),
        ("sizeof(eigenhand_status)".into(), size_of::<Status>()),
        ("sizeof(eigenhand_bytes)".into(), size_of::<Bytes>()),
        ("offsetof(eigenhand_bytes, data)".into(), offset_of!(Bytes, data)),
        ("offsetof(eigenhand_bytes, len)".into(), offset_of!(Bytes, len)),
        ("sizeof(eigenhand_hand_plugin_t)".into(), size_of::<HandPlugin>()),
        (table("magic"), header_at + offset_of!(Header, magic)),
        (table("abi_major"), header_at + offset_of!(Header, abi_major)),
        (table("abi_minor"), header_at + offset_of!(Header, abi_minor)),
        (table("struct_size"), header_at + offset_of!(Header, struct_size)),
        (table("generate"), offset_of!(HandPlugin, generate)),
        (table("file_count"), offset_of!(HandPlugin, file_count)),
        (table("file"), offset_of!(HandPlugin, file)),
        (table("error_message"), offset_of!(HandPlugin, error_message)),
        (table("free"), offset_of!(HandPlugin, free)),
    ];
    let found = values(&expected.iter().map(|(expression, _)| expression.as_str()).collect::<Vec<_>>());
    assert_eq!(found.len(), expected.len());
    for ((expression, expected), found) in expected.iter().zip(found) {
        assert_eq!(found, *expected as u64, "{expression}");
    }
}

#[test]
fn a_table_in_c_has_functions_of_these_types() {
    // Each assignment fails to compile where a signature of the header is another one.
    let text = format!(
        "#include \"eigenhand_hand.h\"
static eigenhand_status generate(const uint8_t *o, size_t n, void **out) {{ (void)o; (void)n; *out = 0; return 1; }}
static eigenhand_status file_count(const void *h, size_t *out) {{ (void)h; *out = 0; return 0; }}
static eigenhand_status file(const void *h, size_t i, eigenhand_bytes *a, eigenhand_bytes *b) {{
    (void)h; (void)i; (void)a; (void)b; return 1;
}}
static eigenhand_status error_message(const void *h, eigenhand_bytes *out) {{ (void)h; (void)out; return 1; }}
static void release(void *h) {{ (void)h; }}
const eigenhand_hand_plugin_t {SYMBOL} = {{
    EIGENHAND_HAND_MAGIC, EIGENHAND_HAND_ABI_MAJOR, EIGENHAND_HAND_ABI_MINOR, sizeof(eigenhand_hand_plugin_t),
    generate, file_count, file, error_message, release
}};
"
    );
    let (source, object) = (scratch("table.c"), scratch("table.o"));
    std::fs::write(&source, text).unwrap();
    cc(&["-c", source.to_str().unwrap(), "-o", object.to_str().unwrap()]);
}
