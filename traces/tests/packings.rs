//! Checks that packing does not change a trace's verdict, and that a cut file is reported.

use std::collections::BTreeMap;
use std::io::{self, BufReader, Cursor, Read, Write};

use flate2::write::GzEncoder;
use fuseline_traces::packed::{unpack, unpack_beside};
use fuseline_traces::{Defect, Events, judge};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};

const TRACE: &str = concat!(
    "{\"fuseline\":1,\"window\":16,\"commit\":\"eager\",\"clouds\":[]}\n",
    "{\"ev\":\"open\",\"at\":5,\"t\":7}\n",
    "{\"ev\":\"result\",\"at\":9,\"t\":7,\"p\":0}\n",
    "{\"ev\":\"emit\",\"at\":9,\"t\":7,\"p\":0}\n",
);

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

fn zstd(bytes: &[u8]) -> Vec<u8> {
    zstd::encode_all(bytes, 0).unwrap()
}

/// Returns an MCAP file with these messages of a topic.
fn mcap(topic: &str, encoding: &str, messages: &[&str], pack: Option<Compression>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = WriteOptions::new().compression(pack).create(&mut bytes).unwrap();
    let channel_id = writer.add_channel(0, topic, encoding, &BTreeMap::new()).unwrap();
    for message in messages {
        let header = MessageHeader { channel_id, sequence: 0, log_time: 9, publish_time: 9 };
        writer.write_to_known_channel(&header, message.as_bytes()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn lines() -> Vec<&'static str> {
    TRACE.lines().collect()
}

fn read(packed: &[u8]) -> io::Result<String> {
    let (mut text, mut beside) = (Vec::new(), Vec::new());
    let read = unpack(packed).and_then(|mut trace| trace.read_to_end(&mut text));
    let unpacked = unpack_beside(Cursor::new(packed.to_vec()));
    let read_beside = unpacked.and_then(|mut trace| trace.read_to_end(&mut beside));
    // The lines before an error are the same too.
    let said = |read: &io::Result<usize>| read.as_ref().map_err(ToString::to_string).copied();
    assert_eq!((said(&read), &text), (said(&read_beside), &beside));
    read?;
    String::from_utf8(text).map_err(io::Error::other)
}

#[test]
fn what_is_unpacked_beside_comes_whole_and_in_order() {
    let (header, lines) = TRACE.split_once('\n').unwrap();
    let long = format!("{header}\n{}", lines.repeat(30_000));
    for packed in [gzip(long.as_bytes()), zstd(long.as_bytes())] {
        assert_eq!(read(&packed).unwrap(), long);
        // A reader that stops does not wait for the rest.
        let mut first = [0; 10];
        unpack_beside(Cursor::new(packed)).unwrap().read_exact(&mut first).unwrap();
        assert_eq!(first, TRACE.as_bytes()[..10]);
    }
}

#[test]
#[should_panic(expected = "the file is gone")]
fn a_panic_beside_is_no_end_of_a_trace() {
    struct Gone(bool);
    impl Read for Gone {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            assert!(!self.0, "the file is gone");
            self.0 = true;
            buffer[..2].copy_from_slice(&[0x1f, 0x8b]);
            Ok(2)
        }
    }
    let mut text = String::new();
    let _ = unpack_beside(BufReader::new(Gone(false))).unwrap().read_to_string(&mut text);
}

#[test]
fn every_packing_gives_the_same_lines() {
    let (first, second) = TRACE.split_at(60);
    let packings: [(&str, Vec<u8>); 8] = [
        ("plain", TRACE.into()),
        ("gzip", gzip(TRACE.as_bytes())),
        ("members", [gzip(first.as_bytes()), gzip(second.as_bytes())].concat()),
        ("zstd", zstd(TRACE.as_bytes())),
        ("frames", [zstd(first.as_bytes()), zstd(second.as_bytes())].concat()),
        ("mcap", mcap("/fuseline/trace", "json", &lines(), None)),
        ("mcap, lz4", mcap("/fuseline/trace", "json", &lines(), Some(Compression::Lz4))),
        ("mcap, zstd", mcap("/fuseline/trace", "json", &lines(), Some(Compression::Zstd))),
    ];
    for (name, packed) in packings {
        assert_eq!(read(&packed).unwrap(), TRACE, "{name}");
        assert!(judge(name, unpack(&packed[..]).unwrap()).unwrap().conforms, "{name}");
    }
}

#[test]
fn messages_are_written_as_lines_of_a_trace() {
    let loose = [lines()[0], lines()[1], r#" {"t":7, "ev":"result","p":0}"#, lines()[3]];
    assert_eq!(read(&mcap("/fuseline/trace", "json", &loose, None)).unwrap(), TRACE);
}

#[test]
fn a_file_cut_short_is_reported_wherever_it_is_cut() {
    for whole in [
        gzip(TRACE.as_bytes()),
        zstd(TRACE.as_bytes()),
        mcap("/fuseline/trace", "json", &lines(), Some(Compression::Zstd)),
    ] {
        for len in 1..whole.len() {
            let cut = &whole[..len];
            let kind = match read(cut) {
                Ok(text) => {
                    // In an MCAP file, everything after the messages may be missing.
                    assert_eq!(text, TRACE, "{len}");
                    assert_eq!(whole[0], 0x89, "{len}");
                    continue;
                }
                Err(error) => error.kind(),
            };
            assert_eq!(kind, io::ErrorKind::UnexpectedEof, "{len} of {}", whole.len());
        }
    }
}

#[test]
fn what_no_trace_can_be_made_of_is_reported() {
    let reported = |packed: &[u8]| read(packed).unwrap_err().to_string();
    let strange = mcap("/camera", "json", &lines(), None);
    assert_eq!(reported(&strange), "there is no message on topic /fuseline/trace");
    let encoded = mcap("/fuseline/trace", "cdr", &lines(), None);
    assert_eq!(
        reported(&encoded),
        "topic /fuseline/trace is encoded as \"cdr\", but the lines of a trace are json"
    );
    let bad = mcap("/fuseline/trace", "json", &[lines()[0], "{}"], None);
    assert!(reported(&bad).starts_with("message 2: column "), "{}", reported(&bad));
    for first in [0x1f, 0x28, 0x89] {
        let junk = [&[first][..], &[7; 100]].concat();
        assert!(read(&junk).is_err(), "{first}");
    }
}

#[test]
fn an_error_of_a_message_has_its_line() {
    let bad = mcap("/fuseline/trace", "json", &[lines()[0], "{}"], None);
    let mut events = Events::new("a.mcap", unpack(&bad[..]).unwrap()).unwrap();
    let error = events.next_event().unwrap_err();
    assert_eq!((error.line, error.column), (2, 1));
    assert!(matches!(error.defect, Defect::Io(_)));
}
