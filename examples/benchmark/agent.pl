# An agent for `activetouch benchmark` in another language: lines of JSON in, lines of JSON out.
#
# activetouch benchmark --task coarse-v1 --agent "process:perl agent.pl" --out perl.jsonl.gz
use strict;
use warnings;
use JSON::PP;

$| = 1;    # every answer leaves at once
my $poses;

sub decision {
    my ($asked) = @_;
    my $prob = $asked->{belief}{ $asked->{target} };
    my $made = @{ $asked->{touches} };    # of the object in front
    return { action => "confirm" } if $prob > 0.95 || ( $made == @$poses && $prob > 0.5 );
    return { action => "reject" }  if $prob < 0.05 || $made == @$poses;
    return { action => "touch", pose => $poses->[$made] };
}

while ( my $line = <STDIN> ) {
    my $asked  = decode_json($line);
    my $answer = { ok => JSON::PP::true };
    if   ( $asked->{do} eq "hello" ) { $poses  = $asked->{poses} }
    else                             { $answer = decision($asked) }
    print encode_json($answer), "\n";
}
