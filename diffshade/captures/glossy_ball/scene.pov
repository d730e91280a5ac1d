// A glossy ball under near point lights, for POV-Ray 3.7, written by make.py.
//   povray +Iscene.pov +O001.png Declare=Shot=1 +W160 +H160 +FN16 File_Gamma=1.0 -A -D
#version 3.7;
#ifndef (Shot) #declare Shot = 1; #end

#declare Ka = <0.04, 0.012, 0.008>;
#declare Kd = <0.7, 0.15, 0.05>;
#declare Ks = 0.4;
#declare N  = 60.0;

global_settings { assumed_gamma 1 ambient_light rgb 1 }

// World axes: x right, y up, z towards the viewer. Explicit vectors keep them right-handed.
camera {
  orthographic
  location <0, 0, 10> direction <0, 0, -1>
  right <2.25, 0, 0> up <0, 2.25, 0>
}

// Colour * 2 / (1 + (d / D)^2)
#macro Near (Position, Colour)
  light_source { Position rgb Colour fade_distance 1.6 fade_power 2 }
#end

#switch (Shot)
  #case (1)
    Near(<-1.1, 1.2, 1.9>, <0.83, 0.83, 0.83>)
  #break
  #case (2)
    Near(<1.2, 0.3, 1.5>, <0.6, 0.6, 0.6>)
  #break
  #case (3)
    Near(<0.2, 1.9, 1.7>, <0.9, 0.8, 0.65>)
  #break
  #case (4)
    Near(<-1.9, 0.6, 2.3>, <1.15, 0.95, 0.75>)
    Near(<1.9, -0.2, -0.5>, <0.8, 1.15, 1.5>)
  #break
  #case (5)
    Near(<0.9, 0.8, 4.4>, <2.4, 2.4, 2.4>)
  #break
  #case (6)
    Near(<-0.7, -1.3, 1.6>, <0.7, 0.6, 0.5>)
    Near(<2.3, 2.4, 2.9>, <2.1, 2.4, 2.7>)
  #break
#end

sphere {
  <0, 0, 0>, 1
  // The pigment multiplies `diffuse` and `ambient`; the highlight has the colour of the light.
  pigment { rgb Kd }
  finish { ambient rgb Ka / Kd diffuse 1 phong Ks phong_size N }
  no_shadow
}
