use fuseline_testkit::Rng;

/// The streams are the same as fastrand 2.5's.
#[test]
fn a_seed_draws_what_it_always_drew() {
    let rng = &mut Rng::with_seed(42);
    let words: Vec<u64> = (0..3).map(|_| rng.next_u64()).collect();
    assert_eq!(
        words,
        [14_587_678_697_106_979_209, 9_105_053_682_160_394_182, 14_839_644_324_764_355_487]
    );
    let eights: Vec<u8> = (0..8).map(|_| rng.u8(3..10)).collect();
    assert_eq!(eights, [6, 5, 5, 7, 3, 8, 8, 4]);
    let words: Vec<u32> = (0..4).map(|_| rng.u32(2..20)).collect();
    assert_eq!(words, [16, 4, 7, 19]);
    let words: Vec<u64> = (0..4).map(|_| rng.u64(1_000..80_000)).collect();
    assert_eq!(words, [79_135, 59_136, 76_163, 20_461]);
    // About half of the draws are rejected and repeated.
    let words: Vec<u64> = (0..3).map(|_| rng.u64(0..(1 << 63) + 1)).collect();
    assert_eq!(
        words,
        [5_232_886_637_160_621_171, 6_819_898_861_923_130_422, 8_554_284_445_770_883_540]
    );
    let words: Vec<usize> = (0..4).map(|_| rng.usize(8..80)).collect();
    assert_eq!(words, [8, 79, 69, 9]);
    let shares: Vec<u64> = (0..3).map(|_| rng.f64().to_bits()).collect();
    assert_eq!(
        shares,
        [4_601_702_172_518_675_354, 4_595_817_726_037_570_054, 4_601_306_814_991_529_399]
    );
    let coins: Vec<bool> = (0..8).map(|_| rng.bool()).collect();
    assert_eq!(coins, [true, true, true, false, false, true, false, false]);
    let mut items: Vec<u8> = (0..10).collect();
    rng.shuffle(&mut items);
    assert_eq!(items, [3, 6, 2, 4, 7, 0, 9, 5, 8, 1]);
    assert_eq!(rng.sample(1..=20, 5), [16, 10, 8, 4, 13]);
}

#[test]
fn every_number_of_a_range_is_drawn_and_no_other() {
    let rng = &mut Rng::with_seed(1);
    let drawn = |draw: &mut dyn FnMut() -> u64| {
        (0..1000).map(|_| draw()).collect::<std::collections::BTreeSet<_>>()
    };
    assert_eq!(drawn(&mut || rng.u64(3..8)), (3..8).collect());
    assert_eq!(drawn(&mut || rng.u8(250..255).into()), (250..255).collect());
    assert_eq!(drawn(&mut || rng.u32(0..5).into()), (0..5).collect());
    assert_eq!(drawn(&mut || rng.usize(7..12) as u64), (7..12).collect());
    assert_eq!(drawn(&mut || rng.one_of(&[2, 9])), [2, 9].into());
    assert_eq!(drawn(&mut || rng.one_in(3).into()), [0, 1].into());
    assert!((0..1000).map(|_| rng.f64_between(2.0, 3.0)).all(|drawn| (2.0..3.0).contains(&drawn)));
}

#[test]
fn of_nothing_the_start_is_drawn() {
    let rng = &mut Rng::with_seed(1);
    assert_eq!((rng.u64(5..5), rng.usize(5..5), rng.u32(5..5), rng.u8(5..5)), (5, 5, 5, 5));
    assert_eq!((rng.index(0), rng.one_in(0)), (0, true));
    assert_eq!(rng.sample([1, 2], 5), [1, 2]);
}
