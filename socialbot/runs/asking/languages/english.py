"""English questions and answers."""

import re
from itertools import product

from socialbot.runs.asking.languages.language import Language, Voices, word_set

_MOMENTS = (
    "time", "moment", "moments", "point", "second", "seconds", "minute", "instant", "stage", "occasion", "occasions",
)  # fmt: skip
_TIMES = ",".join(
    f"{before} {asking} {time}"
    for before, asking, time in product(
        ("at", "in", "on", "from", "until"),
        ("what", "which"),
        _MOMENTS,
    )
)
"""Phrases that ask for a time: ``at which moment``."""

ENGLISH = Language(
    "en",
    {
        "why": (
            "how is it that,how was it that,motive,motivation,purpose,justification,why,what made,what makes,"
            "what brought,how come,for what reason,what reason,what was the reason,what is the reason,reason,"
            "what for,what made you,what makes you,made you,what caused,cause,what led,led you to,what prompted,"
            "prompted you,motivated,explain,on what grounds,what brought you to,justify,account for,"
            "how did you decide,how do you decide,how did you know,how do you know,how could you know,"
            "how could you tell,on what basis,on which basis,based on,based on what,made you think,made you believe,"
            "what convinced,convinced you,what triggered,triggered,how so,grounds,basis,moved you to,"
            "what were you thinking,going through your mind,what was the idea,what was the point,"
            "what was the purpose,because of what,due to what,rationale,reasoning,explanation,what explains,what drove,"
            "drove you to,what inspired,inspired you to,what possessed,possessed you to,what compelled,"
            "compelled you to,"
            "what persuaded,persuaded you to,what motivated,what lies behind,what was behind,on what account,"
            "what induced,induced you to,what prevented,prevented,what hindered,hindered"
        ),
        "what": (
            "what,which thing,anything,describe,something,how did you react,how did you respond,how did you behave,"
            "tell me about,what about,which"
        ),
        "who": (
            "who,list,name,enumerate,whom,which people,which person,which persons,which visitors,which of you,"
            "which agent,which robot,which machine,which of them,which one,which guest,which guests,whose"
        ),
        "when": (
            f"when,{_TIMES},until when,till when,from when,by when,how far into,how far in,"
            "what time,which time,what moment,which moment,since when,what was the time"
        ),
        "how_often": (
            "in how many cases,on how many occasions,"
            "how often,how many times,number of times,how frequently,count how often,how many time,many times"
        ),
        "how_many": (
            "how much people,how much persons,how much visitors,how much times,head count,how many,number of,count,"
            "total number,what number"
        ),
        "unanswerable": (
            "how much,how old,which colour,which color,what colour,what color,how tall,how do,how did,how are,"
            "how can,how was,how is,how will,how big,what is your name,how,who owns,who owned,who does it belong,"
            "who belongs,belong to"
        ),
        "not": (
            "nothing,nobody,no one,not,never,no,without,refuse to,refused to,fail to,failed to,forget to,forgot to,"
            "omit,"
            "prevented,hindered,avoid,neither,"
            "stop you from,stopped you from,keep you from,kept you from,prevented you from,instead of,"
            "leave out,left out,none,no single"
        ),
        "see": (
            "see,saw,seen,look like,notice,observe,in view,in sight,in front of,visible,perceive,sense,detect,"
            "spot anybody,"
            "spot,meet,met,encounter,glimpse,witness,behold,catch sight of,caught sight of,describe scene,"
            "describe picture,describe image,"
            "describe surroundings,describe situation,on camera,"
            "watching,show,recognise,your camera,camera show,looking at,ahead of you,before your eyes,your view"
        ),
        "do": (
            "busy,available,do,doing,done,up to,busy with,working on,act,action,actions,perform,occupied,task,job,"
            "activity,deed,"
            "how did you react,how did you respond,how did you behave,your reaction"
        ),
        "happen": "happen,happened,occurred,going on,occur,went on,what came,what comes,what followed",
        "next": "next,then,afterwards,after that,after this,now on,future,upcoming,following step,soon",
        "plan": (
            "plan to,planning,want to do,you want,have any plans,intend,intention,intentions,going to,will you,want,"
            "left to do,still to do,yet to do,left to be done,agenda,schedule,to do list,goal,goals,aim,desire,"
            "plans,accomplish,achieve,attain,pursue,objective,"
            "objectives,"
            "your plan,are you about,about to,trying to,shall you,aiming"
        ),
        "outcome": (
            "end,ended,ends,finish,finished,succeed,succeeded,success,successful,successfully,complete,completed,outcome,"
            "result,go well,went well,work out,worked out,according to plan,accomplish,accomplished,achieve,achieved,"
            "be over,is over,was over,are over,were over,it over,all over,everything over,come to an end,"
            "came to an end,go smoothly,went smoothly,go according to plan,in order"
        ),
        "fail": (
            "go wrong,goes wrong,went wrong,gone wrong,going wrong,fail,failed,failure,failures,problem,problems,"
            "trouble,error,errors,fault,mistake,mistakes,difficulty,difficulties,not work,no good,run into,ran into,"
            "unsuccessful,break down,broke down,broken down,accident,accidents,incident,incidents,hitch,hitches,"
            "get stuck,got stuck,crash,crashed"
        ),
        "wish": "looking for,look for,looked for,interested in,wish for",
        "say": (
            "hear from you,heard from you,say,said,speak,spoke,tell,told,utter,complain,comment,reply,replied,ask,"
            "asked,mention,shout,pronounce,words,talk,sentence,sentences,phrase,remark,statement,utterance,"
            "utterances,answer,answered,respond,responded"
        ),
        "hear": "hear,heard,overhear,overheard",
        "replies": "reply,replied,answer,answered,respond,responded",
        "asks": "ask,asked,asking,request,requested",
        "here": (
            "here,come,came,visit,visited,arrive,there,around,show up,showed up,turn up,turned up,present,pass by,"
            "walk by,drop by,stop by,enter,appear,leave,left,go away,went away,walk away,walked away,disappear,"
            "hang around,nearby,close to you,near you,next to you,beside you,around you,close by,near the camera,"
            "at your door,at the door,approach,approached,come close,came close,come near,came near,come closer,"
            "came closer"
        ),
        "people": (
            "people,person,persons,visitor,visitors,man,woman,guest,guests,human,humans,guy,chap,fellow,bloke,lad,lady,child,men,women,"
            "anybody,anyone,somebody,someone,everybody,one,faces,folk,folks,individual,individuals,children,kid,kids,"
            "boy,girl,ladies,"
            "couple,pair,duo,group,gentleman,customer,customers,passer by,passers by,"
            "pedestrian,pedestrians,stranger,strangers"
        ),
        "group": "pair,couple,duo,two",
        "nobody": "nobody,no one,noone,room empty,place empty,hall empty",
        "me": "me,i,my,myself,us,we,mine",
        "you": "you,your,yourself,robot,u,ya,ye",
        "them": "him,her,them,they,he,she,that person,this person,that man,that woman,that visitor,it",
        "past": (
            "left,happened,occurred,said,told,spoke,"
            "came,visited,arrived,appeared,saw,did,was,were,have,has,had,been,just,yet,already,so far,until now,ago,"
            "earlier,before,done"
        ),
        "future": "will,shall,going to,next,would",
        "present": "are,is,do,does,can,am,now,currently,right now,at the moment,could",
        "ago": "ago,earlier",
        "first": "first,at first",
        "last": "last,final,latest,most recent,previous,recent",
        "ordinals": "second,third,fourth,fifth,sixth,seventh,eighth,ninth,tenth",
        "time": "time,times",
        "seconds": "s,sec,secs,second,seconds",
        "minutes": "min,mins,minute,minutes",
        "at": "at,around,about,after,in,from,during,by",
        "end": "at the end,at the very end,in the end,at the close,towards the end,near the end,at the finish,finally",
        "overall": "total,altogether,overall,in all,so far,up to now,until now",
        "talk": "speak,talk,converse,chat",
        "silent": (
            "silent,quiet,mute,speechless,silence,hold back,held back,hold off,held off,keep quiet,kept quiet,refrain,"
            "tongue tied,reserved"
        ),
        "request": "can you,could you,would you,will you please,please,can you please,could you please,go and",
        "start": (
            "at the start,at the beginning,at the very start,at the very beginning,in the beginning,initially,"
            "to begin with"
        ),
        "recently": "just now,right now,a moment ago,just,lately,now",
        "how_long": (
            "how long,for how long,how much time,how many seconds,how many minutes,since when,what duration,"
            "which duration,how long did it take,how long it took,how soon,how quickly,what was the length,"
            "what was the duration,length of,duration of,amount of time"
        ),
        "where": "where,whereabouts,to which place,which place,what place,in which place",
        "how_far": (
            "how far,how far away,how close,how near,"
            "at what distance,what distance,at which distance,which distance,what was the distance"
        ),
        "auxiliary": "did,do,does,was,were,have,has,had,is,are,can,could,would,will",
        "all": "everyone,everybody,all,each,every,both",
        "shortest": "shortest,least time,briefest",
        "longest": "longest,the most time,most time",
        "but": "but,and,while,whereas,yet",
        "rather": "rather than,instead of,as opposed to,in place of",
        "event after": "after,as soon as,once,since,following,subsequent to,upon,later than",
        "event before": "before,until,prior to,and then,and afterwards,and after that,earlier than,sooner than",
        "follows": "followed,follows,succeeded,came after,came right after,came directly after,comes after",
        "precedes": "preceded,precedes,led up to,came before,came right before,came just before,comes before",
        "event when": "when,while,the moment,at the moment,as,in response to,in reaction to",
        "comes": "come,came,arrive,enter,appear,approach,show,turn,walk,return",
        "leaves": "leave,left,go,went,gone,disappear,vanish,depart,departed,away,off",
        "waits": "wait,hesitate,delay",
        "matrix": (
            "wonder,wondering,wondered,curious,know,tell,telling,told,remember,recall,ask,asking,interested,hear,learn,"
            "understand,sure,idea,mind,kind,say,explain,like,want,nice,grateful,appreciate,interest,interests,clear,"
            "unclear,figure,find,happy,love,good,great,glad,wish,share,state,describe,specify,forgot,forgotten,"
            "explaining,saying,puzzled,"
            "puzzles,confused,certain,possible,hope,see,able,inform,guess,clarify,question,show,give"
        ),
        "or": "or",
        "which": "which",
        "why not": "why not",
        "complement": (
            "whether,if,true that,case that,correct that,right that,sure that,certain that,fact that,think that"
        ),
        "times": (
            "once,twice,thrice,again,once more,one more time,more than once,several times,many times,multiple times,"
            "repeatedly,another time,every time,each time,all the time,always,number of times,a few times"
        ),
        "others": (
            "else,other than,besides,apart from,aside from,except,except for,only,solely,nobody but,no one but,most,"
            "most of,everything,exclusively"
        ),
        "hypothetical": (
            "what if,would have,would you have,should you,ought you,could you have,"
            "would happen,would have happened,would you do if,should have,could have"
        ),
        "qualified": (
            "because,in order to,so that,together,at the same time,simultaneously,sooner,earlier,later,than,"
            "instead of,rather than,too late,too early,too soon,too long,too often,in time,on time,hardly,"
            "almost,nearly,barely,immediately,at once,by mistake,stop,a woman,a man,a child,a girl,a boy,"
            "a lady,a kid,women,men,children,kids,in english,in german,in french,in spanish"
        ),
        "filler": (
            "excuse me,pardon me,passed,elapsed,um,uh,uhm,today,tonight,this morning,this afternoon,log,record,"
            "trace,footage,output,"
            "decision,erm,er,hm,hmm,huh,eh,oh,ah,yeah,yes,listen,basically,you know,i mean,let me think,let me see,"
            "by the way,out of curiosity,just wondering,curiosity,come on,issue,issued,make,made,making,took place,"
            "might,may,track,mark,show me,take place,taken place,taking place,carry out,carried out,perform,"
            "performed,provide,provided,behind,right,correct,used,use,keep,kept,stay,stayed,remain,remained,picture,"
            "image,scene,my,his,her,their,its,very,quite,altogether,get,got,receive,received,give,gave,given,"
            "given to,away,back,off,out,over,into,onto,inside,toward,towards,please,hey,hi,okay,ok,well,so,tell me,"
            "can you tell me,could you tell me,i would like to know,i want to know,do you know,let me know,"
            "would you say,could you say,can you say,the,a,an,of,to,for,that,this,on,with,and,any,kind,by,it,from,as,"
            "ever,even,really,then,actually,in,at,be,being,like,earth,hell,up,your,want to,decide to,decided to,"
            "choose to,chose to,have to,had to,need to,started to,start,begin,began,some,all,exactly,precisely,there,"
            "here,if,whether,or,but,run,recording,video,during,during the run,total,altogether,together,please tell,"
            "time,whole,again,once,twice,too,also,still,only,thing,things,these,those,such,own,so far,just,than,"
            "more than,simply,overall,long enough,enough,needed,need,needs,think,thought,same,else,other,others,"
            "bother,bothered,manage,managed,happen to,happened to,care to,cared to,dare to,go ahead and,particular,"
            "specific,certain,possibly,maybe,perhaps,indeed,rather,instead,anyway,anyhow,though,although,however,"
            "because,since,due,regarding,concerning,about,within,upon,via,per,beside,among,until,till,entire,case,"
            "situation,occasion,instance,point,sort,matter,session,experiment,test,tape,clip,file,day,sir,buddy,mate,"
            "dude,mister,friend,dear,robo,bot,took care of,take care of,has to do with,had to do with,have you got,"
            "with regard to,kindly,previously,finally,herself,himself,itself,themselves,ended up,end up,in between,"
            "stand,standing,stood,straight away,spend,spent,visit,team,robots,"
            "in the middle of your work,in the middle of your job,in the middle of your task,in the middle of the work,"
            "in the middle of work,in the middle of the job"
        ),
        "place": "room,area,hall",
        "left out": (
            "nothing,left out,leave out,leaving out,miss out,missed out,passed over,pass over,overlooked,overlook,"
            "forget,forgot,forgotten,empty handed,excluded,exclude,neglected,went without,go without,not get anything,"
            "not receive anything,not given anything"
        ),
        "between": "between,in between",
        "called": "called,named,by the name of,whose name is,whose name was,with the name",
        "step": "step,steps",
        "replan": (
            "replan,replanned,replanning,re plan,new plan,another plan,different plan,plan again,planned again,"
            "change your plan,changed your plan,changed plans,change plans,change of plan,revise your plan,"
            "revised your plan,second plan"
        ),
        "to": "to,into,onto,enter,entered,reach,reached,visit,visited",
        "from": "from,leave,left,leaving,exit,exited",
        "article": "the,a,an",
        "being": "is,was,are,were,been,has been,there",
        "at place": "in,inside,within,on,onto,under,underneath,below,above,behind,beside,near,between,at,next to",
    },
    {
        "because": " because",
        "decimal": ".",
        "and": "and",
        "at": "at {at} s",
        "within": "from {at} to {until} s {clause}",
        "ago": "{ago} seconds ago",
        "just_now": "just now",
        "then": "{when} {clause}",
        "person": "person {id}",
        "somebody": "somebody",
        "anybody": "anybody",
        "yes": "Yes",
        "no": "No",
        "unknown": "I don't know",
        "unclear": "I am not sure what you ask",
        "able": (
            "I can tell why I did something or left it undone, what I saw, said, did and intended, and "
            "who was here when"
        ),
        "not_recorded": "the record does not say so",
        "belief": "I believed {what}",
        "no_belief": "I did not believe {what}",
        "saw_none": "I saw nobody",
        "saw_one": "I saw {people}",
        "away": "{person} {distance} m away",
        "side": "{person} {side} of the picture",
        "sides": "on the left|in the middle|on the right",
        "nobody_came": "nobody was here",
        "here": "{person} was here from {at} to {until} s",
        "here_you": "you were here from {at} to {until} s",
        "counted": "{count} people were here",
        "counted_one": "one person was here",
        "times": "{count} times",
        "people": "{count} people",
        "people_one": "one person",
        "times_one": "once",
        "said": 'I said "{what}"',
        "heard": '{person} said "{what}"',
        "heard_you": 'you said "{what}"',
        "failed": "I failed to {what}{why}",
        "ended": "the plan for {what} {outcome}{why}",
        "nothing_failed": "nothing failed",
        "took": "that took {value} s",
        "said_nothing": "I said nothing",
        "not_named": 'the record does not mention "{word}"',
        "said_no_words": 'I did not say "{what}"',
        "nothing_next": "I had no intention",
        "next_was": "the next thing was {when}: {clause}",
        "last_was": "the last thing was {when}: {clause}",
        "nothing_done": "I was doing nothing",
        "wanted": "I wanted {what}",
        "assumes": "I take you for person {id}.",
        "examples": (
            "Why did you {deed}? | What do you see? | What will you do next? | Who was here? | When did you {deed}? "
            "| How often did you {deed}? | Did you {deed}? | What did you do at {at} seconds?"
        ),
    },
    Voices(
        you=word_set("you u ya ye"),
        to_you=word_set("you u ya ye"),
        passive=word_set("was were been being is are be get got gotten gets"),
        by=word_set("by"),
        receive=word_set("get got gotten receive received"),
        source=word_set("from"),
        third=frozenset(),
        participle=re.compile(".*(ed|en|wn)|told|sent|brought|taught|led|let|met|shown"),
    ),
)
