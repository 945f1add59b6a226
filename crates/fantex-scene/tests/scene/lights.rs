//! Lamps and what shading shares.

mod light {
    use fantex_scene::Falloff;

    #[test]
    fn light_weakens_with_the_square_and_ends_at_its_range() {
        let falloff = Falloff::InverseSquare { reference: 2.0, range: Some(20.0) };
        let free = Falloff::InverseSquare { reference: 2.0, range: None };
        assert_eq!(free.factor(2.0), 1.0);
        assert!((free.factor(6.0) - 1.0 / 9.0).abs() < 1e-6);
        assert!(falloff.factor(6.0) < free.factor(6.0) && falloff.factor(6.0) > 0.98 * free.factor(6.0));
        assert_eq!(falloff.factor(20.0), 0.0);
        assert_eq!(falloff.factor(30.0), 0.0);
        assert!(free.factor(0.0).is_finite());
    }
}

mod shading {
    use fantex_scene::split_sum;

    #[test]
    fn mirrors_reflect_all_and_rough_metals_less() {
        for n_v in [0.1, 0.5, 1.0] {
            let total = |roughness| split_sum(roughness, n_v).iter().sum::<f32>();
            assert!((total(0.0) - 1.0).abs() < 0.01, "{}", total(0.0));
            assert!(total(1.0) < 0.9 && total(1.0) > 0.3, "{}", total(1.0));
        }
    }

    #[test]
    fn grazing_mirrors_reflect_whatever_their_colour() {
        let [scale, bias] = split_sum(0.05, 0.05);
        assert!(bias > 0.6 && scale < 0.4, "{scale} {bias}");
    }
}
