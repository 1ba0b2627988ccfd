//! URIs: inline data, or a file in the model's folder. Nothing else is followed.

use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

use super::error::{Fault, Read, cannot_read, malformed, quoted};

const DATA: &str = "data:";
/// No system has longer paths; percent-encoding makes three bytes of one.
const MOST_NAME_BYTES: usize = 3 * 4096;

/// What a URI stands for.
#[derive(Debug, PartialEq)]
pub(super) enum Target {
    /// The decoded payload of a `data:` URI.
    Data(Vec<u8>),
    /// An existing file below the model's folder, links resolved.
    File(PathBuf),
    /// The same, found by another name than the specification's reading.
    Misspelt(PathBuf),
}

/// Follows `uri`, which stands at `place` in the document.
///
/// A name that is not there as the specification reads it is looked for as careless exporters write
/// it: with `%` and blanks as they are, with backslashes between folders, with a query behind it,
/// and below folders of another machine ([`ends`]).
///
/// Refuses schemes other than `data:` and `file:`, and files outside `folder`, links among them.
pub(super) fn resolve(uri: &str, folder: &Path, place: &str) -> Read<Target> {
    if let Some(rest) = strip_prefix_ignoring_case(uri, DATA) {
        return decode_data(rest, place).map(Target::Data);
    }
    if uri.len() > MOST_NAME_BYTES {
        return Err(too_long(uri, place));
    }
    let find = |name: &str| match name.chars().any(char::is_control) {
        true => Err(malformed(place, "a file name", "a control character")),
        false => file_below(name, folder, place),
    };
    let decoded = percent_decode(uri.as_bytes())
        .and_then(|bytes| String::from_utf8(bytes).ok())
        .ok_or_else(|| malformed(place, "percent-encoded UTF-8", quoted(uri)));
    let fault = match scheme(uri) {
        Some(scheme) => {
            let found = format!("the scheme {scheme}:");
            malformed(place, "a data: URI or a file name", found)
        }
        None => match decoded.as_deref().map_err(Fault::clone).and_then(find) {
            Ok(path) => return Ok(Target::File(path)),
            Err(fault) => fault,
        },
    };
    // A drive's letter is no scheme, and files of another machine may lie here.
    let is_file = |scheme: &str| scheme.len() == 1 || scheme.eq_ignore_ascii_case("file");
    if !scheme(uri).is_none_or(is_file) {
        return Err(fault);
    }
    let spellings = [decoded.as_deref().ok(), Some(uri)];
    let slashed = spellings.map(|name| name.map(|it| it.replace('\\', "/")));
    let found = spellings
        .into_iter()
        .chain(slashed.each_ref().map(Option::as_deref));
    let mut found = found.flatten().filter_map(|name| find(name).ok());
    let found = found.next().or_else(|| {
        let names = slashed.iter().flatten().map(String::as_str);
        // A query may hold slashes of its own.
        let bare = names
            .clone()
            .filter_map(|name| Some(name.split_once(['?', '#'])?.0));
        bare.chain(names).find_map(|name| {
            let inside = without_steps(name);
            let mut ends = inside.as_deref().into_iter().chain(ends(name));
            ends.find_map(|end| find(end).ok())
        })
    });
    found.map(Target::Misspelt).ok_or(fault)
}

/// A path that begins with folders of another machine, by its ends: the longest first, without the
/// folders before them.
pub(super) fn ends(name: &str) -> impl Iterator<Item = &str> {
    /// Folders before the file's name that are looked into.
    const MOST_FOLDERS: usize = 8;
    let slashes: Vec<usize> = name.match_indices(['/', ':']).map(|it| it.0).collect();
    let first = slashes.len().saturating_sub(MOST_FOLDERS);
    let last = slashes.into_iter().skip(first);
    last.map(|slash| &name[slash + 1..])
}

/// A relative path without `.` and `..`; `None` for one that is absolute or leads out.
fn without_steps(name: &str) -> Option<String> {
    let mut folders = Vec::new();
    for component in Path::new(name).components() {
        match component {
            Component::Normal(folder) => folders.push(folder.to_str()?),
            Component::CurDir => {}
            Component::ParentDir => {
                folders.pop()?;
            }
            Component::RootDir | Component::Prefix(_) => return None,
        }
    }
    Some(folders.join("/"))
}

fn too_long(name: &str, place: &str) -> Fault {
    let expected = format!("a file name of {MOST_NAME_BYTES} bytes at most");
    malformed(place, expected, quoted(name))
}

/// Whether `uri` is inline data.
pub(super) fn is_data(uri: &str) -> bool {
    strip_prefix_ignoring_case(uri, DATA).is_some()
}

/// The existing file `name`, a path relative to `folder`, links resolved; the same refusals as [`resolve`].
pub(super) fn file_below(name: &str, folder: &Path, place: &str) -> Read<PathBuf> {
    if name.len() > MOST_NAME_BYTES {
        return Err(too_long(name, place));
    }
    let inside = |component| matches!(component, Component::Normal(_) | Component::CurDir);
    // A backslash separates on Windows only; refusing it everywhere keeps a file's meaning the same everywhere.
    if name.is_empty() || name.contains('\\') || !Path::new(name).components().all(inside) {
        return Err(malformed(
            place,
            "a relative path below the model's folder",
            quoted(name),
        ));
    }
    // The reference as written: where the folder lies is for the caller to tell.
    let real = folder
        .join(name)
        .canonicalize()
        .map_err(|cause| cannot_read(place, Path::new(name), &cause))?;
    let real_folder = folder
        .canonicalize()
        .map_err(|cause| cannot_read(place, folder, &cause))?;
    if !real.starts_with(&real_folder) {
        let found = format!("a link from {} to elsewhere", quoted(name));
        return Err(malformed(place, "a file below the model's folder", found));
    }
    // A named pipe would block, a device would never end.
    if !real.is_file() {
        return Err(malformed(place, "a regular file", quoted(name)));
    }
    Ok(real)
}

/// `file` of `file:///x`, `c` of `c:/x`.
fn scheme(uri: &str) -> Option<&str> {
    let (scheme, _) = uri.split_once(':')?;
    let mut bytes = scheme.bytes();
    let starts = bytes.next()?.is_ascii_alphabetic();
    let rest = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'-' | b'.');
    (starts && bytes.all(rest)).then_some(scheme)
}

fn strip_prefix_ignoring_case<'a>(text: &'a str, prefix: &str) -> Option<&'a str> {
    let start = text.get(..prefix.len())?;
    start
        .eq_ignore_ascii_case(prefix)
        .then(|| &text[prefix.len()..])
}

/// `[media type][;base64],payload`, as forgiving as browsers are: base64 may be percent-encoded and
/// broken into lines, and may use the alphabet of file names.
fn decode_data(rest: &str, place: &str) -> Read<Vec<u8>> {
    let Some((header, payload)) = rest.split_once(',') else {
        return Err(malformed(place, "a comma in the data: URI", "none"));
    };
    let unescaped = |text| {
        percent_decode(text)
            .ok_or_else(|| malformed(place, "percent-encoding in the data: URI", "a broken one"))
    };
    let header = unescaped(header.as_bytes())?;
    let mut parts = header.rsplit(|&byte| byte == b';');
    let last = parts.next().unwrap_or_default().trim_ascii();
    if parts.next().is_none() || !last.eq_ignore_ascii_case(b"base64") {
        return unescaped(payload.as_bytes());
    }
    let mut text = Cow::Borrowed(payload.as_bytes());
    if text.contains(&b'%') {
        text = unescaped(&text)?.into();
    }
    if text.iter().any(u8::is_ascii_whitespace) {
        text.to_mut().retain(|byte| !byte.is_ascii_whitespace());
    }
    decode_base64(&text)
        .ok_or_else(|| malformed(place, "base64 in the data: URI", "other characters"))
}

/// RFC 3986: `%20` is a blank and `+` stays a plus. `None` at a `%` without two hexadecimal digits.
fn percent_decode(text: &[u8]) -> Option<Vec<u8>> {
    let digit = |byte: u8| char::from(byte).to_digit(16).map(|digit| digit as u8);
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text;
    while let [first, tail @ ..] = rest {
        rest = tail;
        if *first != b'%' {
            bytes.push(*first);
            continue;
        }
        let [high, low, tail @ ..] = rest else {
            return None;
        };
        bytes.push(digit(*high)? << 4 | digit(*low)?);
        rest = tail;
    }
    Some(bytes)
}

/// RFC 4648 sections 4 and 5; the padding may be absent, stray bits and other characters may not be
/// there.
fn decode_base64(text: &[u8]) -> Option<Vec<u8>> {
    let digit = |byte: u8| -> Option<u32> {
        Some(u32::from(match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        }))
    };
    let padding = text
        .iter()
        .rev()
        .take(2)
        .take_while(|&&byte| byte == b'=')
        .count();
    if padding > 0 && !text.len().is_multiple_of(4) {
        return None;
    }
    let text = &text[..text.len() - padding];
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for quad in text.chunks(4) {
        let mut bits = 0;
        for &byte in quad {
            bits = bits << 6 | digit(byte)?;
        }
        bits <<= 6 * (4 - quad.len());
        let length = match quad.len() {
            4 => 3,
            3 if bits & 0xff == 0 => 2,
            2 if bits & 0xffff == 0 => 1,
            _ => return None,
        };
        bytes.extend_from_slice(&bits.to_be_bytes()[1..=length]);
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    // A failing unwrap is a failing test.
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn base64_follows_the_vectors_of_rfc_4648() {
        let vectors = [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9vYg==", "foob"),
            ("Zm9vYmE=", "fooba"),
            ("Zm9vYmFy", "foobar"),
            ("Zm9vYmE", "fooba"),
        ];
        for (text, bytes) in vectors {
            assert_eq!(
                decode_base64(text.as_bytes()).unwrap(),
                bytes.as_bytes(),
                "{text}"
            );
        }
        for text in [
            "@@@@", "Z", "Zg=", "Zh==", "Zm9=", "Zg==Zg==", "Zm 9v", "====",
        ] {
            assert_eq!(decode_base64(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn data_uris_may_be_percent_encoded() {
        let decode = |uri: &str| resolve(uri, Path::new("."), "uri").unwrap();
        assert_eq!(decode("data:,a%20b+"), Target::Data(b"a b+".to_vec()));
        assert_eq!(decode("DATA:x/y;base64,AAE="), Target::Data(vec![0, 1]));
        for uri in [
            "data:x/y;base64,+/8B/g==",
            "data:x/y;base64,%2B%2f8B%2Fg%3D%3D",
            "data:x/y;base64,%2B/8B%0A%2Fg%3d=",
            "data:x/y;base64,+/8\r\nB\t/g\u{c}= =\n",
            "data: x/y ; BASE64 , +/8B/g==",
            "data:; base64,-_8B_g",
            "data:x/y;charset=x;base64,-/8B_g==",
            "data:x/y%3Bbase64,+/8B/g==",
        ] {
            assert_eq!(
                decode(uri),
                Target::Data(vec![0xfb, 0xff, 1, 0xfe]),
                "{uri:?}"
            );
        }
        // Without the word it is text, whatever it looks like.
        for header in ["", "base64", "x/y;base64;a=b"] {
            let uri = format!("data:{header},AA E=");
            assert_eq!(decode(&uri), Target::Data(b"AA E=".to_vec()), "{header}");
        }
        for uri in [
            "data:;base64,@@@@",
            "data:;base64,AA%3",
            "data:;base64",
            "data:,%2",
        ] {
            assert!(resolve(uri, Path::new("."), "uri").is_err(), "{uri}");
        }
    }

    #[test]
    fn careless_names_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        std::fs::create_dir(folder.join("sub dir")).unwrap();
        for name in [
            "sub dir/a b.png",
            "100%.png",
            "a%20b.png",
            "%41.png",
            "A.png",
        ] {
            std::fs::write(folder.join(name), "x").unwrap();
        }
        let follow = |uri: &str| resolve(uri, &folder, "images[0].uri").unwrap();
        for (uri, name) in [
            ("sub dir/a b.png", "sub dir/a b.png"),
            ("sub%20dir/a%20b.png", "sub dir/a b.png"),
            ("100%25.png", "100%.png"),
            // The specification's reading comes first.
            ("%41.png", "A.png"),
        ] {
            assert_eq!(follow(uri), Target::File(folder.join(name)), "{uri}");
        }
        for (uri, name) in [
            ("sub dir\\a b.png", "sub dir/a b.png"),
            ("sub%20dir\\a%20b.png", "sub dir/a b.png"),
            ("sub%20dir%5Ca%20b.png", "sub dir/a b.png"),
            (".\\100%.png", "100%.png"),
            ("C:\\work\\A.png", "A.png"),
            ("C:/models/sub%20dir/a%20b.png", "sub dir/a b.png"),
            ("d:A.png", "A.png"),
            ("/home/me/sub dir/a b.png", "sub dir/a b.png"),
            ("file:///C:/models/A.png", "A.png"),
            ("FILE://host/sub%20dir/a%20b.png", "sub dir/a b.png"),
            ("\\\\host\\share\\A.png", "A.png"),
            ("//host/share/A.png", "A.png"),
            ("a/../A.png", "A.png"),
            ("sub%20dir/x/../a%20b.png", "sub dir/a b.png"),
            ("../A.png", "A.png"),
            ("..\\textures\\A.png", "A.png"),
            ("A.png?v=1", "A.png"),
            ("A.png#layer", "A.png"),
            ("/x/A.png?from=/y/100%25.png", "A.png"),
            ("100%.png", "100%.png"),
            ("a%20b.png", "a%20b.png"),
        ] {
            assert_eq!(follow(uri), Target::Misspelt(folder.join(name)), "{uri}");
        }
    }

    #[test]
    fn only_files_below_the_folder_are_followed() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("model");
        std::fs::create_dir_all(folder.join("sub")).unwrap();
        std::fs::write(parent.path().join("secret"), "s").unwrap();
        std::fs::write(folder.join("sub/a b+.bin"), "x").unwrap();
        let follow = |uri: &str| resolve(uri, &folder, "buffers[0].uri");
        let real = folder.canonicalize().unwrap().join("sub/a b+.bin");
        assert_eq!(
            follow("sub/a%20b+.bin").unwrap(),
            Target::File(real.clone())
        );
        assert_eq!(follow("./sub/a%20b+.bin").unwrap(), Target::File(real));
        for uri in [
            "../secret",
            "%2e%2e/secret",
            "sub/../../secret",
            "/etc/hostname",
            "//host/x",
            "",
            "sub",
            "file:///etc/hostname",
            "http://127.0.0.1:9/x",
            "C:/x",
            "..\\secret",
            "a%00",
            "a%2",
            "%ff",
        ] {
            assert!(follow(uri).is_err(), "{uri}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("../secret", folder.join("link")).unwrap();
            let text = follow("link").unwrap_err().to_string();
            assert!(text.contains("below the model's folder"), "{text}");
            std::os::unix::fs::symlink("sub", folder.join("inner")).unwrap();
            assert!(follow("inner/a%20b+.bin").is_ok());
        }
    }
}
