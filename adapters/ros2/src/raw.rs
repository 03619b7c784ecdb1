//! Messages as they are on the wire: CDR, passed on without a look inside.

use std::cell::Cell;
use std::convert::Infallible;

#[cfg(feature = "zenoh")]
use byteorder::{BigEndian, LittleEndian};
use bytes::Bytes;
use rustdds::RepresentationIdentifier as Encoding;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};

/// A serialized message: passed on byte for byte, whatever its type.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Payload {
    /// The byte order that its encapsulation header names.
    pub big_endian: bool,
    /// Returns the bytes after the encapsulation header.
    pub body: Bytes,
}

/// Takes payloads out of DDS samples and puts them into samples, unchanged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cdr;

/// The encapsulations that are accepted: plain CDR of either byte order, which is what ROS 2 sends.
const ENCODINGS: [Encoding; 2] = [Encoding::CDR_BE, Encoding::CDR_LE];

/// The length of an encapsulation header, in bytes.
const ENCAPSULATION: usize = 4;

thread_local! {
    /// The byte order of the payload last given to `to_bytes`. The library queries the adapter, not
    /// the value, for the encoding, right after the value's bytes and on the same thread.
    static BIG_ENDIAN: Cell<bool> = const { Cell::new(false) };
}

impl Payload {
    /// Returns the message with its encapsulation header, as `rmw_serialize` has it.
    #[must_use]
    pub fn to_serialized(&self) -> Bytes {
        [&self.encapsulation()[..], &self.body].concat().into()
    }

    /// Returns the encapsulation header.
    pub(crate) fn encapsulation(&self) -> [u8; ENCAPSULATION] {
        let encoding = if self.big_endian { Encoding::CDR_BE } else { Encoding::CDR_LE };
        let [first, second] = encoding.to_bytes();
        [first, second, 0, 0]
    }

    /// Returns the message behind an encapsulation header; none if the header is missing or not
    /// plain CDR.
    #[must_use]
    pub fn from_serialized(bytes: &Bytes) -> Option<Self> {
        let header = bytes.get(..ENCAPSULATION)?;
        let encoding = ENCODINGS.into_iter().find(|known| header.starts_with(&known.to_bytes()))?;
        let body = bytes.slice(ENCAPSULATION..);
        Some(Self { big_endian: encoding == Encoding::CDR_BE, body })
    }
}

#[cfg(feature = "zenoh")]
impl Payload {
    /// Returns a message of the node's own, serialized.
    pub(crate) fn of(message: &impl serde::Serialize) -> Option<Self> {
        let body = cdr_encoding::to_vec::<_, LittleEndian>(message).ok()?;
        Some(Self { big_endian: false, body: body.into() })
    }

    /// Returns the message, if it is one of this type.
    pub(crate) fn read<M: serde::de::DeserializeOwned>(&self) -> Option<M> {
        let read = if self.big_endian {
            cdr_encoding::from_bytes::<M, BigEndian>(&self.body)
        } else {
            cdr_encoding::from_bytes::<M, LittleEndian>(&self.body)
        };
        read.ok().map(|(message, _)| message)
    }
}

impl SerializerAdapter<Payload> for Cdr {
    type Error = Infallible;

    fn output_encoding() -> Encoding {
        if BIG_ENDIAN.get() { Encoding::CDR_BE } else { Encoding::CDR_LE }
    }

    fn to_bytes(payload: &Payload) -> Result<Bytes, Infallible> {
        BIG_ENDIAN.set(payload.big_endian);
        Ok(payload.body.clone())
    }
}

impl DeserializerAdapter<Payload> for Cdr {
    type Error = Infallible;
    type Decoded = Payload;

    fn supported_encodings() -> &'static [Encoding] {
        &ENCODINGS
    }

    fn transform_decoded(payload: Payload) -> Payload {
        payload
    }
}

impl DefaultDecoder<Payload> for Cdr {
    type Decoder = Self;
    const DECODER: Self = Self;
}

impl Decode<'_, Payload> for Cdr {
    type Error = Infallible;

    fn decode_bytes(self, bytes: &[u8], encoding: Encoding) -> Result<Payload, Infallible> {
        let big_endian = encoding == Encoding::CDR_BE;
        Ok(Payload { big_endian, body: Bytes::copy_from_slice(bytes) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// D2.
    #[test]
    fn a_payload_comes_back_from_its_serialized_form_in_either_byte_order() {
        for big_endian in [false, true] {
            let payload = Payload { big_endian, body: Bytes::from_static(b"body") };
            let bytes = payload.to_serialized();
            assert_eq!(bytes[..4], [0, u8::from(!big_endian), 0, 0]);
            assert_eq!(Payload::from_serialized(&bytes), Some(payload.clone()));
            assert_eq!(Cdr::to_bytes(&payload), Ok(payload.body));
            assert_eq!(Cdr::output_encoding() == Encoding::CDR_BE, big_endian);
        }
    }

    #[test]
    fn what_is_not_plain_cdr_is_none() {
        for bytes in [&b""[..], &[0, 1, 0], &[0, 3, 0, 0, 1], &[1, 0, 0, 0, 1]] {
            assert_eq!(Payload::from_serialized(&Bytes::copy_from_slice(bytes)), None);
        }
    }
}
