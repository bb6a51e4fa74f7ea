//! Reads the groups (code and value pairs) of an ASCII DXF file, with their lines.

use crate::error::{Diagnostics, MapErrorKind};

/// Larger files are refused. The whole city has less than a megabyte.
pub const MAX_BYTES: usize = 16 << 20;

/// A code, its value and the line of the file on which the code stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct DxfGroup<'a> {
    /// Group code: the meaning of the value.
    pub code: i32,
    /// Bytes of the value line without its line ending, not trimmed.
    pub value: &'a [u8],
    /// Counted from 1.
    pub line: usize,
}

impl DxfGroup<'_> {
    /// The trimmed value as text.
    pub(super) fn keyword(&self) -> String {
        String::from_utf8_lossy(self.value.trim_ascii()).into_owned()
    }
}

/// Reads groups one by one.
#[derive(Debug)]
pub(super) struct GroupReader<'a> {
    rest: &'a [u8],
    line: usize,
}

/// The file cannot be parsed further; the diagnostics hold the reason.
#[derive(Debug)]
pub(super) struct MalformedFile;

impl<'a> GroupReader<'a> {
    /// Rejects what is evidently not an ASCII DXF file.
    pub(super) fn new(bytes: &'a [u8], diagnostics: &mut Diagnostics) -> Result<Self, MalformedFile> {
        const AS_DXF: &str = "save the drawing as ASCII DXF, release 2000 or later";
        let mut line = 1;
        let refusal = if bytes.len() > MAX_BYTES {
            Some((
                format!("the file has {} MiB, more than {}", bytes.len() >> 20, MAX_BYTES >> 20),
                "keep only the map in the drawing (PURGE removes unused blocks)",
            ))
        } else if bytes.trim_ascii().is_empty() {
            Some(("the file is empty".to_owned(), AS_DXF))
        } else if bytes.starts_with(b"AutoCAD Binary DXF") {
            Some(("the file is a binary DXF".to_owned(), AS_DXF))
        } else if bytes.starts_with(b"AC10") {
            Some(("the file is a DWG drawing".to_owned(), AS_DXF))
        } else {
            bytes.iter().position(|&b| b == 0).map(|at| {
                line += bytes[..at].iter().filter(|&&b| b == b'\n').count();
                ("a zero byte: the file is not text".to_owned(), AS_DXF)
            })
        };
        if let Some((message, remedy)) = refusal {
            diagnostics.error_at(MapErrorKind::Format, line, String::new(), message, remedy);
            return Err(MalformedFile);
        }
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        Ok(Self { rest, line: 0 })
    }

    /// The line that was read last.
    pub(super) fn line(&self) -> usize {
        self.line
    }

    fn next_line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        self.line += 1;
        let (line, rest) = match self.rest.iter().position(|&b| b == b'\n') {
            Some(at) => (&self.rest[..at], &self.rest[at + 1..]),
            None => (self.rest, &[][..]),
        };
        self.rest = rest;
        Some(line.strip_suffix(b"\r").unwrap_or(line))
    }

    /// The next group, `None` at the end of the file.
    pub(super) fn next(
        &mut self,
        diagnostics: &mut Diagnostics,
    ) -> Result<Option<DxfGroup<'a>>, MalformedFile> {
        let Some(code_line) = self.next_line() else { return Ok(None) };
        let line = self.line;
        let code = std::str::from_utf8(code_line).ok().and_then(|text| text.trim().parse::<i32>().ok());
        let Some(code) = code else {
            if self.rest.trim_ascii().is_empty() && code_line.trim_ascii().is_empty() {
                return Ok(None);
            }
            diagnostics.error_at(
                MapErrorKind::Format,
                line,
                String::new(),
                format!("expected a group code, found \"{}\"", shown(code_line)),
                "codes and values must alternate line by line: save the drawing again",
            );
            return Err(MalformedFile);
        };
        match self.next_line() {
            Some(value) => Ok(Some(DxfGroup { code, value, line })),
            None => {
                diagnostics.error_at(
                    MapErrorKind::Format,
                    line,
                    String::new(),
                    format!("the file ends after group code {code}, without its value"),
                    "the file is cut off: save or copy it again",
                );
                Err(MalformedFile)
            }
        }
    }
}

/// Untrusted bytes for a message: printable and short.
pub(super) fn shown(bytes: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(bytes.trim_ascii())
        .chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .take(40)
        .collect();
    if bytes.len() > 40 { text + "..." } else { text }
}
