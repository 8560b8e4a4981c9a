mod common;
use argus_scene::*; use common::*; use glam::*;
#[test]
fn dbg() {
    let garden = Analytic { spheres: vec![(DVec3::new(0.0, 2.0, 0.0), 1.5)], ..Analytic::garden() };
    let cams = [perspective(DVec3::new(0.0, 4.0, -8.0), DVec3::new(0.0, 1.0, 0.0), 70.0, 200, 150)];
    let set = sample_set(&garden, &cams, false, 1);
    let mut c = compositor(&set);
    let eye = DVec3::new(7.0, 5.0, -3.0);
    let camera = Camera::look_at(eye, DVec3::new(0.0, 0.0, 3.0));
    let (w,h)=(200u32,150u32);
    let mut img = image::RgbImage::new(2*w, 2*h);
    for (k, s) in [Search::Splat, Search::Linear].into_iter().enumerate() {
    let view = job(&set, camera, [w, h], s);
    let f = compose_one(&mut c, &view).unwrap();
    for i in 0..(w*h) as usize {
        let at = DVec2::new((i as u32 % w) as f64 + 0.5, (i as u32 / w) as f64 + 0.5);
        let t = garden.see(eye, camera.direction(at, w, h)).map_or(f64::INFINITY, |t| t.0);
        let r = f.range.as_ref().unwrap();
        let got = f32::from_le_bytes(r[4*i..4*i+4].try_into().unwrap()) as f64;
        let e = if t == got { 0 } else { ((got / t - 1.0).abs() * 2000.0).min(255.0) as u8 };
        let (x,y)=(i as u32 % w + k as u32 * w, i as u32 / w);
        img.put_pixel(x, y, image::Rgb([e, f.mask.as_ref().unwrap()[i], f.source.as_ref().unwrap()[i]*30]));
        let col=f.color.as_ref().unwrap();
        img.put_pixel(x, y+h, image::Rgb([col[3*i],col[3*i+1],col[3*i+2]]));
    }}
    let img = image::imageops::resize(&img, 4*w, 4*h, image::imageops::FilterType::Nearest);
    img.save("/tmp/pics/dbg.png").unwrap();
}
