//! TCPROS handshake: the connection headers that both ends of a topic exchange first.

use std::collections::BTreeMap;
use tokio::io::{AsyncRead, AsyncReadExt};

/// Longest header, bytes; message definitions are its longest part.
const MAX_HEADER_BYTES: usize = 64 << 10;

/// Fields of a connection header, by name.
pub(super) type ConnectionHeader = BTreeMap<String, String>;

/// Encodes a header with its length prefix.
pub(super) fn encode(fields: &[(&str, &str)]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, value) in fields {
        body.extend(((name.len() + 1 + value.len()) as u32).to_le_bytes());
        body.extend(name.as_bytes());
        body.push(b'=');
        body.extend(value.as_bytes());
    }
    let mut bytes = (body.len() as u32).to_le_bytes().to_vec();
    bytes.append(&mut body);
    bytes
}

/// Reads a header.
///
/// # Errors
/// The reason, when it is too long, incomplete or malformed.
pub(super) async fn read(from: &mut (impl AsyncRead + Unpin)) -> Result<ConnectionHeader, String> {
    let length = from.read_u32_le().await.map_err(|error| error.to_string())? as usize;
    if length > MAX_HEADER_BYTES {
        return Err(format!("a header of {length} bytes, at most {MAX_HEADER_BYTES} are read"));
    }
    let mut bytes = vec![0; length];
    from.read_exact(&mut bytes).await.map_err(|error| error.to_string())?;
    decode(&bytes)
}

fn decode(mut bytes: &[u8]) -> Result<ConnectionHeader, String> {
    let mut fields = ConnectionHeader::new();
    while !bytes.is_empty() {
        let (length, rest) = bytes.split_first_chunk().ok_or("a truncated field in a header")?;
        let length = u32::from_le_bytes(*length) as usize;
        let (field, rest) = rest.split_at_checked(length).ok_or("a truncated field in a header")?;
        let field = std::str::from_utf8(field).map_err(|_| "a field of a header is not UTF-8")?;
        let (name, value) = field.split_once('=').ok_or("a field of a header without =")?;
        fields.insert(name.to_owned(), value.to_owned());
        bytes = rest;
    }
    Ok(fields)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_header_comes_back_as_it_was() {
        let bytes =
            encode(&[("topic", "/tf"), ("message_definition", "float64 x # = y\n"), ("latching", "0")]);
        assert_eq!(bytes.len(), 4 + u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize);
        let fields = decode(&bytes[4..]).unwrap();
        assert_eq!(fields["topic"], "/tf");
        assert_eq!(fields["message_definition"], "float64 x # = y\n");
        assert!(decode(&bytes[4..bytes.len() - 1]).unwrap_err().contains("truncated"));
    }

    proptest! {
        #[test]
        fn no_bytes_are_too_strange(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            // Any input is decoded or refused, without a panic.
            let _ = decode(&bytes);
        }
    }
}
