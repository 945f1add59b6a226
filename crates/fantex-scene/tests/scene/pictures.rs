//! Pictures, glow and tone mapping.

mod picture {
    use fantex_scene::{Picture, ToneMap};
    use fantex_texture::{ColorSpace, Samples};
    use glam::Vec3;

    #[test]
    fn images_have_the_right_encoding_and_channels() {
        let opaque =
            Picture { width: 2, height: 1, rgba: vec![[0.0, 0.5, 1.0, 1.0], [2.0, 0.215_861, 0.0, 1.0]] };
        let bytes = opaque.to_srgb_image();
        assert_eq!((bytes.channels, bytes.space), (3, ColorSpace::Srgb));
        assert_eq!(bytes.samples, Samples::U8(vec![0, 188, 255, 255, 128, 0]));
        let see_through = Picture { width: 1, height: 1, rgba: vec![[0.5, 0.25, 3.0, 0.5]] };
        assert_eq!(see_through.to_srgb_image().samples, Samples::U8(vec![188, 137, 255, 128]));
        assert_eq!(see_through.to_linear_image().samples, Samples::F32(vec![0.5, 0.25, 3.0, 0.5]));
    }

    #[test]
    fn curves_rise_from_black_to_white() {
        for tone_map in [ToneMap::Clip, ToneMap::Reinhard, ToneMap::Filmic] {
            assert_eq!(tone_map.map(Vec3::ZERO), Vec3::ZERO, "{tone_map:?}");
            let mut before = 0.0;
            for i in 0..200 {
                let now = tone_map.map(Vec3::splat(i as f32 * 0.05)).x;
                assert!(now >= before && now <= 1.0, "{tone_map:?} at {i}");
                before = now;
            }
            assert!(before > 0.99, "{tone_map:?}: {before}");
            assert!(tone_map.map(Vec3::splat(f32::MAX)).is_finite());
        }
    }

    #[test]
    fn reinhard_keeps_hues_and_maps_its_white_to_one() {
        let reinhard = ToneMap::Reinhard;
        assert!((reinhard.map(Vec3::splat(ToneMap::WHITE)) - 1.0).length() < 1e-5);
        let (color, mapped) = (Vec3::new(0.8, 0.4, 0.2), reinhard.map(Vec3::new(0.8, 0.4, 0.2)));
        assert!((mapped / mapped.x - color / color.x).length() < 1e-5);
    }

    #[test]
    fn the_filmic_curve_has_its_published_values() {
        let at = |x: f32| ToneMap::Filmic.map(Vec3::splat(x)).x;
        assert!((at(1.0) - 2.54 / 3.16).abs() < 1e-6);
        assert!((at(0.18) - 0.18 * (2.51 * 0.18 + 0.03) / (0.18 * (2.43 * 0.18 + 0.59) + 0.14)).abs() < 1e-6);
    }
}
