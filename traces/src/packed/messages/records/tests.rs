//! Compares the records with those that the library reads from the same files, one at a time.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Compression, WriteOptions};

use super::*;

/// The records with their codes, and the error after them.
type ReadRecords = (Vec<(u8, Vec<u8>)>, Option<String>);

const PACKINGS: [Option<Compression>; 3] = [None, Some(Compression::Zstd), Some(Compression::Lz4)];

/// Returns a file with 20 messages, in chunks of about ten or without chunks.
fn file(packing: Option<Compression>, has_chunks: bool) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = WriteOptions::new().compression(packing).chunk_size(Some(512));
    let mut writer = options.use_chunks(has_chunks).create(&mut bytes).unwrap();
    let schema = writer.add_schema("a", "jsonschema", b"{}").unwrap();
    let channel_id = writer.add_channel(schema, "/a", "json", &BTreeMap::new()).unwrap();
    for sequence in 0..20 {
        let log_time = u64::from(sequence);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        let data = format!("{{\"a\":{}}}", sequence * sequence);
        writer.write_to_known_channel(&header, data.as_bytes()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// Returns `true` if records of this kind are handed over wherever they are.
fn is_taken(opcode: u8) -> bool {
    matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE)
}

fn by_library(mut bytes: &[u8]) -> ReadRecords {
    let options = LinearReaderOptions::default()
        .with_record_length_limit(RECORD)
        .with_validate_chunk_crcs(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut records = Vec::new();
    loop {
        match reader.next_event() {
            None => return (records, None),
            Some(Err(error)) => return (records, Some(error.to_string())),
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                records.extend(is_taken(opcode).then(|| (opcode, data.to_vec())));
            }
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                let (some, rest) = bytes.split_at(wanted.min(bytes.len()));
                reader.insert(some.len()).copy_from_slice(some);
                reader.notify_read(some.len());
                bytes = rest;
            }
        }
    }
}

fn by_blocks(bytes: &[u8]) -> ReadRecords {
    let mut blocks = RecordBlocks::new(bytes);
    let (mut records, mut block) = (Vec::new(), Vec::new());
    loop {
        match blocks.fill(&mut block) {
            Ok(true) => {}
            Ok(false) => return (records, None),
            Err(error) => {
                assert!(!blocks.fill(&mut block).unwrap(), "nothing follows an error");
                return (records, Some(error.to_string()));
            }
        }
        let mut rest = &block[..];
        while let Some((head, after)) = rest.split_first_chunk() {
            let (opcode, len) = split_head(*head);
            let (data, after) = after.split_at(usize::try_from(len).unwrap());
            records.extend(is_taken(opcode).then(|| (opcode, data.to_vec())));
            rest = after;
        }
        assert!(rest.is_empty(), "a block has whole records");
    }
}

fn assert_same(read: &ReadRecords, expected: &ReadRecords, place: usize) {
    let counts = |records: &ReadRecords| (records.0.len(), records.1.clone());
    assert_eq!(counts(read), counts(expected), "{place}");
    assert!(read.0 == expected.0, "{place}");
}

#[test]
fn records_agree_with_the_library_on_cut_files() {
    for (packing, has_chunks) in
        PACKINGS.map(|packing| (packing, true)).into_iter().chain([(None, false)])
    {
        let whole = file(packing, has_chunks);
        assert!(by_blocks(&whole).0.len() >= 22, "{packing:?}");
        for len in 0..=whole.len() {
            let cut = &whole[..len];
            assert_same(&by_blocks(cut), &by_library(cut), len);
        }
    }
}

#[test]
fn records_agree_with_the_library_on_wrong_bytes() {
    for (packing, has_chunks) in
        PACKINGS.map(|packing| (packing, true)).into_iter().chain([(None, false)])
    {
        let whole = file(packing, has_chunks);
        for place in 0..whole.len() {
            for bits in [1, 0xff] {
                let mut wrong = whole.clone();
                wrong[place] ^= bits;
                let read = by_blocks(&wrong);
                // If a record exceeds a plain chunk, the library's own arithmetic overflows.
                let overrun = McapError::UnexpectedEoc.to_string();
                if packing.is_none() && read.1.as_ref() == Some(&overrun) {
                    continue;
                }
                let mut expected = by_library(&wrong);
                // A fault in packed bytes is found earlier if more is unpacked at once.
                if read.1.as_ref().is_some_and(|error| error.starts_with("Error during decomp")) {
                    assert!(expected.1.is_some() && expected.0.starts_with(&read.0), "{place}");
                    continue;
                }
                // For a chunk that holds more than it claims, the library reports the difference.
                if expected.1.as_ref().is_some_and(|error| error.contains("decompressor wrote")) {
                    expected.1 = Some(overrun);
                }
                assert_same(&read, &expected, place);
            }
        }
    }
}

/// Returns a file with one unpacked chunk whose records claim this many bytes, and a chunk's end
/// after it.
fn plain_chunk(claimed: u64) -> Vec<u8> {
    let records = [&[op::MESSAGE][..], &3_u64.to_le_bytes(), b"abc"].concat();
    let chunk = [&[0; CHUNK][..], &claimed.to_le_bytes(), &records, &[0; 4]].concat();
    let len = (chunk.len() as u64).to_le_bytes();
    [MAGIC, &[op::CHUNK], &len, &chunk].concat()
}

#[test]
fn a_record_ends_in_its_chunk() {
    // There is one record of 12 bytes. A smaller claim cuts it off, and a greater one starts a
    // second record that is incomplete.
    for (claimed, is_whole) in [(0, true), (1, false), (11, false), (12, true), (13, false)] {
        let reported = by_blocks(&plain_chunk(claimed)).1.unwrap();
        let is_overrun = reported == McapError::UnexpectedEoc.to_string();
        assert_eq!(is_overrun, !is_whole, "{claimed}: {reported}");
    }
}

#[test]
fn a_record_longer_than_a_block_is_whole() {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer =
        WriteOptions::new().compression(Some(Compression::Zstd)).create(&mut bytes).unwrap();
    let channel_id = writer.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
    for len in [3, 3 * BLOCK, 7] {
        let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
        writer.write_to_known_channel(&header, &vec![b'a'; len]).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let bytes = bytes.into_inner();
    let read = by_blocks(&bytes);
    assert!(read.1.is_none() && read.0.iter().any(|(_, data)| data.len() > 3 * BLOCK));
    assert_same(&read, &by_library(&bytes), bytes.len());
}
