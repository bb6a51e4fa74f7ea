use city3d::scenario::*; use city3d::runner::*; use std::sync::Arc;
fn main(){
 let a:Vec<String>=std::env::args().collect();
 let (t,l)=Library::scenario(&a[1]).unwrap();
 let e=Arc::new(read_experiment(&a[1],&t,&l,Overrides::default()).unwrap());
 let mut run=Run::new(e.clone()).unwrap();
 let until:f64=a[2].parse().unwrap();
 while run.snapshot().time_s<until { run.step(); }
 let m=&e.lab_map;
 for i in 0..e.vehicles.len(){ let why=run.mainframe().why(i); let c=&run.mainframe().cavs()[i];
  let li=c.route.index_at(c.front_s());
  let sec=c.route.sections.get(c.passage.next_section);
  let adm:Vec<String>=c.passage.admissions.iter().map(|a|{let s=&c.route.sections[a.section];format!("#{}[{:.2}..{:.2}]",a.order,s.from_s-c.front_s(),s.to_s-c.front_s())}).collect();
  println!("{:>3} v{:.3} {} +{:.2} yield={} next: {} adm {:?} {}",c.id,c.speed_mps(),m.lane(c.route.lanes()[li]).name,c.front_s()-c.route.lane_start(li),c.is_yielding,
   sec.map(|s|format!("hold {:.2} rank {} from {:.2} to {:.2} n{}",s.hold_s-c.front_s(),s.rank,s.from_s-c.front_s(),s.to_s-c.front_s(),s.crossings.len())).unwrap_or_default(),adm,why);
 }
}
