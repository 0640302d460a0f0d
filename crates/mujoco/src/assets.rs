//! Checks of a model's files, before MuJoCo reads them: MuJoCo 2.2.2 trusts the indices of an OBJ file and the sizes of a height
//! field, and reads beyond the file where they are wrong.

/// Most vertices of an OBJ file, and most points of a height field.
const MOST: usize = 10_000_000;
/// Bytes before the points of a height field: rows and columns.
const HEADER: usize = 8;

/// Checks one file of a model.
///
/// # Errors
/// What is wrong with it.
pub(crate) fn check(xml: &str, name: &str, bytes: &[u8]) -> Result<(), String> {
    let extension = name.rsplit_once('.').map(|(_, extension)| extension.to_ascii_lowercase()).unwrap_or_default();
    if extension == "obj" {
        return check_obj(bytes);
    }
    if extension != "png" && is_height_field(xml, name) {
        return check_height_field(bytes);
    }
    Ok(())
}

/// Tells whether a model reads a height field from a file.
fn is_height_field(xml: &str, name: &str) -> bool {
    let named = format!("file=\"{name}\"");
    xml.split("<hfield").skip(1).any(|rest| rest.split('>').next().is_some_and(|tag| tag.contains(&named)))
}

fn check_height_field(bytes: &[u8]) -> Result<(), String> {
    let number = |at: usize| Some(i32::from_ne_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let (Some(rows), Some(columns)) = (number(0), number(4)) else {
        return Err(format!("it has {} bytes, and no numbers of rows and columns", bytes.len()));
    };
    let points = i64::from(rows) * i64::from(columns);
    if rows < 1 || columns < 1 || points > MOST as i64 {
        return Err(format!("it has {rows} rows and {columns} columns; at most {MOST} points are read"));
    }
    let expected = HEADER as i64 + 4 * points;
    if bytes.len() as i64 != expected {
        return Err(format!("it has {} bytes, but {rows} rows and {columns} columns need {expected}", bytes.len()));
    }
    Ok(())
}

fn check_obj(bytes: &[u8]) -> Result<(), String> {
    // Vertices, texture coordinates and normals, and the greatest index of each.
    let (mut counts, mut greatest) = ([0_usize; 3], [0_usize; 3]);
    for (number, line) in String::from_utf8_lossy(bytes).lines().enumerate() {
        let number = number + 1;
        let mut words = line.split('#').next().unwrap_or_default().split_whitespace();
        let kind = words.next().unwrap_or_default();
        match kind {
            "v" | "vt" | "vn" => {
                let bad = |word: &&str| !word.parse::<f64>().is_ok_and(f64::is_finite);
                if let Some(word) = words.find(bad) {
                    return Err(format!("line {number}: expected finite numbers, got {word:?}"));
                }
                counts[["v", "vt", "vn"].iter().position(|known| *known == kind).unwrap_or(0)] += 1;
            }
            "f" | "l" | "p" => {
                for corner in words {
                    for (i, index) in corner.split('/').enumerate().filter(|(_, index)| !index.is_empty()) {
                        let known = counts.get(i).copied().unwrap_or(0);
                        let found = match index.parse::<i64>() {
                            Ok(index) if index > 0 => index as usize,
                            Ok(index) if index < 0 && index.unsigned_abs() as usize <= known => known,
                            _ => return Err(format!("line {number}: {corner:?} names no corner")),
                        };
                        let Some(greatest) = greatest.get_mut(i) else {
                            return Err(format!("line {number}: {corner:?} has too many indices"));
                        };
                        *greatest = found.max(*greatest);
                    }
                }
            }
            _ => {}
        }
    }
    if counts.iter().any(|count| *count > MOST) {
        return Err(format!("it has more than {MOST} vertices"));
    }
    let names = ["vertices", "texture coordinates", "normals"];
    match (0..counts.len()).find(|&i| greatest[i] > counts[i]) {
        Some(i) => Err(format!("a face names number {} of {} {}", greatest[i], counts[i], names[i])),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, bytes: &[u8]) -> Result<(), String> {
        check("<mujoco><asset><hfield name=\"h\" size=\"1 1 1 1\" file=\"h.bin\"/></asset></mujoco>", name, bytes)
    }

    #[test]
    fn an_obj_file_must_name_its_own_corners() {
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n";
        for good in ["f 1 2 3", "f -3 -2 -1", "f 1//1 2//1 3//1", "# f 9 9 9", ""] {
            assert_eq!(of("a.obj", format!("{corners}{good}\n").as_bytes()), Ok(()), "{good}");
        }
        for bad in ["f 1 2 4", "f 0 1 2", "f -4 -2 -1", "f 1//2 2//1 3//1", "f 1/1 2/1 3/1", "f 1 2 x", "v 0 nan 0",
            "f 1 2 99999999999999999999", "f 1/1/1/1 2 3", "v 1e999 0 0"]
        {
            assert!(of("a.OBJ", format!("{corners}{bad}\n").as_bytes()).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_height_field_must_have_its_points() {
        let field = |rows: i32, columns: i32, points: usize| {
            [&rows.to_ne_bytes()[..], &columns.to_ne_bytes()[..], &vec![0; 4 * points][..]].concat()
        };
        assert_eq!(of("h.bin", &field(2, 3, 6)), Ok(()));
        for (rows, columns, points) in [(2, 3, 5), (2, 3, 7), (0, 3, 0), (-2, -3, 6), (65536, 65536, 0), (i32::MAX, 2, 0)] {
            assert!(of("h.bin", &field(rows, columns, points)).is_err(), "{rows} x {columns}");
        }
        assert!(of("h.bin", &[1, 0, 0]).is_err());
        assert_eq!(of("other.bin", &[1, 0, 0]), Ok(()), "it is no height field");
    }
}
